#include "ros/adapter/controllets/input_reader.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "common/text.hpp"
#include "ros/adapter/adapter_part.hpp"

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

}  // namespace multipanda::ros
