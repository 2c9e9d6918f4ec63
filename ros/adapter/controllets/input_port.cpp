#include "ros/adapter/controllets/input_port.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include <fmt/format.h>

#include "common/text.hpp"
#include "ros/adapter/adapter_part.hpp"
#include "ros/rcl/executor.hpp"
#include "runtime/request_text.hpp"

namespace multipanda::ros {

namespace {

// Limits the length of names from messages in a report.
std::string shortened(const std::string& text) { return fmt::format("'{}'", text.substr(0, 60)); }

bool has_frame(Quantity quantity) { return quantity != Quantity::joints && quantity != Quantity::scalar; }

}  // namespace

std::string message_type(Quantity quantity) {
  return with_message(quantity, []<class M>() -> std::string { return rosidl_generator_traits::name<M>(); });
}

InputReader::InputReader(const InputSpec& spec, std::vector<NamedArm> arms, std::size_t arm)
    : spec_(spec), arms_(std::move(arms)), arm_(arm) {
  joints_ = joint_names(arms_[arm_].name, arms_[arm_].model->joint_count());
  if (!has_frame(spec_.quantity)) return;
  frames_.emplace_back(spec_.frame, std::nullopt);
  if (spec_.frame != kWorldFrame) return;
  for (const auto& named : arms_) frames_.emplace_back(base_frame(named.name), named.model->X_WB());
}

std::vector<std::string> InputReader::frames() const {
  std::vector<std::string> names;
  for (const auto& frame : frames_) names.push_back(frame.first);
  return names;
}

InputReader::Refusal InputReader::read(const geometry_msgs::msg::PoseStamped& message, Target& target) const {
  const auto& p = message.pose.position;
  const auto& q = message.pose.orientation;
  return take({p.x, p.y, p.z, q.w, q.x, q.y, q.z}, message.header.frame_id, target);
}

InputReader::Refusal InputReader::read(const geometry_msgs::msg::TwistStamped& message,
                                       Target& target) const {
  const auto& v = message.twist.linear;
  const auto& w = message.twist.angular;
  return take({v.x, v.y, v.z, w.x, w.y, w.z}, message.header.frame_id, target);
}

InputReader::Refusal InputReader::read(const geometry_msgs::msg::WrenchStamped& message,
                                       Target& target) const {
  const auto& f = message.wrench.force;
  const auto& m = message.wrench.torque;
  return take({f.x, f.y, f.z, m.x, m.y, m.z}, message.header.frame_id, target);
}

InputReader::Refusal InputReader::read(const std_msgs::msg::Float64& message, Target& target) const {
  return take({message.data}, "", target);
}

InputReader::Refusal InputReader::read(const sensor_msgs::msg::JointState& message, Target& target) const {
  const auto& names = message.name;
  const auto& q = message.position;
  if (names.empty()) return read(q, "", target);
  if (names.size() != q.size())
    return fmt::format("{} names with {} positions; expected one position per name", names.size(), q.size());
  std::uint32_t found = 0;  // one bit per joint of the arm
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto joint = std::find(joints_.begin(), joints_.end(), names[i]);
    if (joint == joints_.end()) {
      const bool of_another = std::any_of(arms_.begin(), arms_.end(), [&](const NamedArm& other) {
        return other.name != arms_[arm_].name && names[i].starts_with(other.name + "_");
      });
      const bool fingers = names[i].starts_with(arms_[arm_].name + "_finger");
      if (of_another || fingers) continue;
      return fmt::format("there is no joint {}{}", shortened(names[i]),
                         name_hint(names[i], joints_, "there are none"));
    }
    const auto k = static_cast<std::size_t>(joint - joints_.begin());
    if ((found >> k & 1u) != 0) return fmt::format("joint {} is named twice", shortened(names[i]));
    found |= 1u << k;
    target.values[k] = q[i];
  }
  for (std::size_t k = 0; k < joints_.size(); ++k) {
    if ((found >> k & 1u) == 0) return fmt::format("joint '{}' is missing; expected all joints", joints_[k]);
  }
  target.size = static_cast<std::uint8_t>(joints_.size());
  return finish("", target);
}

InputReader::Refusal InputReader::read(const std::vector<double>& values, const std::string& frame,
                                       Target& target) const {
  target.set(values);
  return finish(frame, target);
}

InputReader::Refusal InputReader::take(std::initializer_list<double> values, const std::string& frame,
                                       Target& target) const {
  target.set(values);
  return finish(frame, target);
}

InputReader::Refusal InputReader::finish(const std::string& frame, Target& target) const {
  const auto named =
      std::find_if(frames_.begin(), frames_.end(), [&](const auto& f) { return f.first == frame; });
  if (has_frame(spec_.quantity) && !frame.empty() && named == frames_.end())
    return fmt::format("there is no frame {}{}", shortened(frame),
                       name_hint(frame, frames(), "there is none"));
  if (named != frames_.end() && named->second) target.to_world(spec_.quantity, *named->second);
  return {};
}

namespace {

std::vector<NamedArm> named_arms(const AdapterContext& run) {
  std::vector<NamedArm> arms;
  for (ArmIndex a = 0; a < run.modes->arm_count(); ++a)
    arms.push_back({run.modes->arm_name(a), run.models[a]});
  return arms;
}

}  // namespace

InputPort::InputPort(const AdapterContext& run, InstanceIndex instance, std::size_t input)
    : run_(run),
      instance_(instance),
      input_(static_cast<std::uint16_t>(input)),
      reference_(&run.modes->instance(instance).inputs()[input]),
      reader_(reference_->spec(), named_arms(run),
              run.modes->instance(instance).arm_list()[reference_->spec().arm]),
      name_(run.modes->instance(instance).name() + "/" + reference_->spec().name) {}

bool InputPort::receive(const std::vector<double>& values, const std::string& frame, Delivery delivery,
                        double waited_s, const void* from) {
  Target target;
  target.delivery = delivery;
  return conclude(reader_.read(values, frame, target), target, waited_s, from);
}

InputPort::Admission InputPort::admits(const std::vector<double>& values, const std::string& frame,
                                       double waited_s, const void* from, HostTime now) const {
  Admission admission;
  admission.target.delivery = Delivery::stream;
  if (auto refusal = reader_.read(values, frame, admission.target)) {
    admission.why = std::move(*refusal);
  } else {
    admission.why = obstacle(admission.target, waited_s, from, now, admission.not_active);
  }
  return admission;
}

void InputPort::refuse(const std::string& why, bool not_active) { note(why, not_active); }

std::string InputPort::obstacle(const Target& target, double waited_s, const void* from, HostTime now,
                                bool& not_active) const {
  const bool stream = target.delivery == Delivery::stream;
  if (stream && from != streams_ && now < streams_until_)
    return "another topic of this input streams to it: stop that one first";
  // A message delayed this long by an overloaded computer was meant for another position of the arm.
  const double patience = stream ? reference_->spec().timeout_s : MultimodeController::kPatience;
  if (waited_s > patience)
    return fmt::format("it waited for more than {:g} s on this overloaded computer", patience);
  if (std::string why = run_.executor->late(patience); !why.empty()) return why;
  const Request request = request_for(target);
  const Verdict verdict = run_.modes->check_sample(request);
  not_active = verdict == Verdict::not_active;
  return verdict == Verdict::accepted ? "" : reason(*run_.modes, request, verdict);
}

Request InputPort::request_for(const Target& target) const {
  Request request{.kind = Request::Kind::set_target};
  request.instance = instance_;
  request.index = input_;
  request.target = target;
  return request;
}

bool InputPort::conclude(InputReader::Refusal refusal, const Target& target, double waited_s,
                         const void* from) {
  const HostTime now = host_now();
  bool not_active = false;
  std::string why = refusal ? std::move(*refusal) : obstacle(target, waited_s, from, now, not_active);
  if (!why.empty()) {
    note(std::move(why), not_active);
    return false;
  }
  if (target.delivery == Delivery::stream) {
    const double timeout_s = reference_->spec().timeout_s;
    return post(target, from, now + std::chrono::nanoseconds(std::llround(1e9 * timeout_s)));
  }
  const Request request = request_for(target);
  std::uint64_t ticket = 0;
  return settle(
      run_.modes->post(std::span(&request, 1), ticket, MultimodeController::kPatience, run_.executor->sent()),
      request);
}

bool InputPort::post(const Target& sample, const void* from, HostTime until) {
  const Request request = request_for(sample);
  if (!settle(run_.modes->post_sample(request), request)) return false;
  streams_ = from;
  streams_until_ = until;
  return true;
}

bool InputPort::settle(Verdict verdict, const Request& request) {
  if (verdict != Verdict::accepted) {
    note(reason(*run_.modes, request, verdict), verdict == Verdict::not_active);
    return false;
  }
  run_.counters->samples_accepted.fetch_add(1, std::memory_order_relaxed);
  const std::lock_guard lock(mutex_);
  ++counts_.received;
  counts_.last_accepted = true;
  return true;
}

void InputPort::note(std::string why, bool not_active) {
  run_.counters->samples_refused.fetch_add(1, std::memory_order_relaxed);
  bool is_new = false;
  {
    const std::lock_guard lock(mutex_);
    ++counts_.received;
    ++counts_.refused;
    // Publishers normally stream while another controllet is active: warn once, then only count.
    is_new = !not_active || counts_.last_accepted || counts_.last_reason != why;
    counts_.last_accepted = false;
    counts_.last_not_active = not_active;
    counts_.last_reason = why;
  }
  if (is_new) run_.warn(name_, "~/" + name_ + ": refused: " + why);
}

InputPort::Counts InputPort::counts() const {
  const std::lock_guard lock(mutex_);
  return counts_;
}

Diagnostic InputPort::diagnostic() const {
  const Counts now = counts();
  Diagnostic line{.name = name_};
  const bool troubled = !now.last_accepted && !now.last_not_active;
  line.level = troubled ? Diagnostic::Level::warn : Diagnostic::Level::ok;
  line.message = troubled            ? "the newest message was refused: " + now.last_reason
                 : now.received == 0 ? "no message so far"
                                     : "";
  line.values = {{"received", std::to_string(now.received)},
                 {"refused", std::to_string(now.refused)},
                 {"last reason", now.last_reason}};
  return line;
}

}  // namespace multipanda::ros
