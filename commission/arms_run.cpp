#include "commission/arms_run.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>
#include <utility>

#include <fmt/format.h>

#include "arm_interface/arm_error.hpp"
#include "arm_interface/arm_settings.hpp"
#include "commission/limits.hpp"
#include "scene/build.hpp"

namespace multipanda::commission {
namespace {

constexpr std::array kLaws{std::pair{Law::guide, "gravity_compensation"},
                           std::pair{Law::joint, "joint_impedance"},
                           std::pair{Law::cartesian, "cartesian_impedance"}};
constexpr double kHandSpeed = 0.1;  // of set-points [m/s]
constexpr double kPatience_s = 20;  // waiting time for actions of the loop or an arm
constexpr std::chrono::milliseconds kLook{50};
constexpr std::uint64_t kNever = std::numeric_limits<std::uint64_t>::max();
// An arm may report the end of a motion before its reason: waiting time for the reason [s].
constexpr double kExplains_s = 0.1;

std::string name_of(const std::string& arm, Law law) {
  if (law == Law::hold) return arm + "_hold";
  for (const auto& [known, type] : kLaws) {
    if (known == law) return arm + "_commission_" + type;
  }
  return {};
}

}  // namespace

JointVector Track::mean(ArmIndex arm, JointArray ArmSample::*quantity, std::size_t joints) const {
  const auto n = static_cast<Eigen::Index>(joints);
  JointVector sum = JointVector::Zero(n);
  for (const auto& sample : arms[arm]) sum += Eigen::Map<const Eigen::VectorXd>((sample.*quantity).data(), n);
  return sum / static_cast<double>(std::max<std::size_t>(1, arms[arm].size()));
}

Scene commission_scene(Scene scene) {
  scene.controllets.clear();
  scene.controllet_places.clear();
  scene.active.clear();
  scene.timeline.clear();
  scene.duration_s = 0;
  scene.contact_bounds = tighter(scene.contact_bounds, ContactBounds{.hand_speed = kHandSpeed});
  for (ArmIndex i = 0; i < scene.arms.size(); ++i) {
    SceneArm& arm = scene.arms[i];
    for (const auto& [law, type] : kLaws) {
      InstanceConfig config{.name = name_of(arm.name, law), .type = type, .arms = {i}};
      config.contact = scene.contact_bounds;
      scene.controllets.push_back(config);
    }
    arm.collision = careful_thresholds(*build_arm_model(arm), arm.collision);
    // A reflex may have stopped the arm at a person: only a person clears it.
    if (arm.fci) arm.fci->recover_at_start = false;
  }
  return scene;
}

ArmsRun::ArmsRun(Scene scene, const Registry& registry, const BackendOptions& backend, bool paced,
                 std::function<bool()> stopped)
    : newest_(scene.arms.size()), expected_(scene.arms.size(), kNoInstance), stopped_(std::move(stopped)) {
  track_.arms.resize(scene.arms.size());
  SessionOptions options{.paced = paced, .backend = backend};
  options.observer = [this](const CycleRecord& record) { take(record); };
  session_ = std::make_unique<Session>(std::move(scene), registry, std::move(options));
}

ArmsRun::~ArmsRun() {
  try {
    end();
  } catch (const std::exception&) {  // already reported by check()
  }
}

void ArmsRun::take(const CycleRecord& record) {
  const std::lock_guard lock(mutex_);
  newest_ = record.arms;
  cycle_ = record.cycle;
  t_ = record.t.seconds();
  // Records come after answers: one from before the last switch shows a hold that is not the stop's.
  if (stopping_ && cycle_ > answered_ && newest_[*stopping_].owner == expected_[*stopping_]) {
    stopping_.reset();
    expected_from_ = cycle_;
    stopped_by_ = record.start + std::chrono::nanoseconds(record.stages.total);
  }
  if (recording_ && record.start < watched_from_) {
    begin_ = t_;
  } else if (recording_ && ++skip_ >= every_) {
    skip_ = 0;
    track_.t.push_back(t_ - begin_);
    for (std::size_t i = 0; i < record.arms.size(); ++i) track_.arms[i].push_back(record.arms[i]);
  }
  changed_.notify_all();
}

void ArmsRun::start() {
  session_->start();
  started_ = true;
  const HostTime begin = host_now();
  std::unique_lock lock(mutex_);
  const auto all_seen = [this] {
    return std::all_of(newest_.begin(), newest_.end(), [](const auto& arm) { return arm.sequence > 0; });
  };
  const auto all_ready = [this] {
    return std::all_of(newest_.begin(), newest_.end(), [](const auto& arm) {
      return arm.sequence > 0 && takes_commands(static_cast<ArmMode>(arm.mode));
    });
  };
  while (!all_ready()) {
    changed_.wait_for(lock, kLook);
    const bool late = seconds(host_now() - begin) > kPatience_s || (stopped_ && stopped_());
    lock.unlock();
    const bool over = session_->wait_for_end(0);
    lock.lock();
    if (!over && !late) continue;
    std::string why;
    for (ArmIndex i = 0; all_seen() && i < newest_.size(); ++i) why += why_left(i);
    lock.unlock();
    end();  // rethrows the exception that ended the loop
    throw std::runtime_error(why.empty() ? "the arms did not start torque control" : why);
  }
  for (ArmIndex i = 0; i < expected_.size(); ++i) expected_[i] = instance(i, Law::hold);
  expected_from_ = cycle_ + 1;
}

void ArmsRun::halt() {
  if (started_ && !ended_) session_->modes().stop(ArmSet::all(arm_count()));
}

void ArmsRun::end() {
  if (ended_ || !started_) return;
  ended_ = true;
  session_->stop();
  while (!session_->wait_for_end(1)) {
  }
  (void)session_->finish();
}

std::string ArmsRun::why_left(ArmIndex arm) const {
  if (excused_ == arm) return {};
  const ArmSample& now = newest_[arm];
  const std::string& name = session_->scene().arms[arm].name;
  const auto mode = static_cast<ArmMode>(now.mode);
  if (!takes_commands(mode)) {
    const std::string errors = error_names(now.errors);
    if (mode == ArmMode::user_stopped) return fmt::format("arm '{}': its user stop is pressed", name);
    if (mode == ArmMode::disconnected) return fmt::format("arm '{}': its connection is lost", name);
    return fmt::format("arm '{}' stopped itself{}", name, errors.empty() ? "" : ": " + errors);
  }
  if (expected_[arm] != kNoInstance && cycle_ >= expected_from_ && now.owner != expected_[arm]) {
    const Intervention rule = session_->removed_by(arm);
    return fmt::format("arm '{}' was taken from '{}' and is held: {}", name,
                       session_->layout().instances[expected_[arm]].name,
                       rule == Intervention::none ? "another request took it" : to_string(rule));
  }
  if (expected_[arm] != kNoInstance && expected_[arm] == instance(arm, Law::guide)) {
    const double fastest = std::abs(*std::max_element(
        now.dq.begin(), now.dq.begin() + 4, [](double a, double b) { return std::abs(a) < std::abs(b); }));
    if (!(fastest <= kGuideSpeed)) {
      return fmt::format(
          "arm '{}': a joint moved at {:.1f} rad/s during hand guiding, expected at most {:g} rad/s: the arm "
          "falls or rises (wrong load), or it was guided too fast; it is held",
          name, fastest, kGuideSpeed);
    }
  }
  return {};
}

std::string ArmsRun::why_left() const {
  std::string why;
  for (ArmIndex i = 0; i < newest_.size() && why.empty(); ++i) why = why_left(i);
  return why;
}

bool ArmsRun::unexplained() const {
  bool found = false;
  for (ArmIndex i = 0; i < newest_.size(); ++i) {
    if (why_left(i).empty()) continue;
    const auto mode = static_cast<ArmMode>(newest_[i].mode);
    if (takes_commands(mode) || mode == ArmMode::user_stopped || mode == ArmMode::disconnected ||
        newest_[i].errors != 0)
      return false;
    found = true;
  }
  return found;
}

void ArmsRun::check() {
  if (session_->wait_for_end(0)) throw ArmLeft("the run of the arms has ended");
  std::unique_lock lock(mutex_);
  if (why_left().empty()) return;
  changed_.wait_for(lock, std::chrono::duration<double>(kExplains_s), [this] { return !unexplained(); });
  if (const std::string why = why_left(); !why.empty()) throw ArmLeft(why);
}

ArmSample ArmsRun::newest(ArmIndex arm) const {
  const std::lock_guard lock(mutex_);
  return newest_[arm];
}

JointVector ArmsRun::q(ArmIndex arm, const ArmSample& sample) const {
  return Eigen::Map<const Eigen::VectorXd>(sample.q.data(), static_cast<Eigen::Index>(joint_count(arm)));
}

double ArmsRun::fastest_joint(ArmIndex arm, const ArmSample& sample) const {
  return Eigen::Map<const Eigen::VectorXd>(sample.dq.data(), static_cast<Eigen::Index>(joint_count(arm)))
      .cwiseAbs()
      .maxCoeff();
}

ModelTerms ArmsRun::terms(ArmIndex arm) const {
  ModelTerms terms(session_->models()[arm]);
  const ArmConfig config = arm_config(scene().arms[arm]);
  terms.set_config(config.frames, config.tool, config.load);
  return terms;
}

void ArmsRun::excuse(std::optional<ArmIndex> arm) {
  const std::lock_guard lock(mutex_);
  excused_ = arm;
}

Track ArmsRun::watch(double duration, unsigned every, const std::function<bool(const Track&)>& enough) {
  std::unique_lock lock(mutex_);
  track_.t.clear();
  for (auto& arm : track_.arms) arm.clear();
  every_ = every;
  skip_ = every - 1;
  begin_ = t_;
  // Records come late: those from before the stop do not count.
  watched_from_ = std::exchange(stop_asked_, HostTime{});
  recording_ = true;
  std::string why;
  HostTime heard = host_now();
  double t_heard = t_;
  std::size_t seen = 0;  // evaluates each sample once
  const auto is_enough = [&] {
    if (!enough || track_.t.size() == seen) return false;
    seen = track_.t.size();
    return enough(track_);
  };
  while (t_ < begin_ + duration && why.empty() && !is_enough()) {
    changed_.wait_for(lock, kLook);
    why = why_left();
    if (!why.empty() && unexplained()) {
      changed_.wait_for(lock, std::chrono::duration<double>(kExplains_s), [this] { return !unexplained(); });
      why = why_left();
    }
    if (t_ != t_heard) {
      t_heard = t_;
      heard = host_now();
    } else if (seconds(host_now() - heard) > kPatience_s) {
      why = "the loop stopped recording cycles";
    }
    lock.unlock();
    const bool over = session_->wait_for_end(0);
    lock.lock();
    if (over && why.empty()) why = "the run of the arms has ended";
    if (stopped_ && stopped_()) why = "stopped on request";
  }
  recording_ = false;
  if (why.empty() && stopping_) {
    why = fmt::format("arm '{}' did not go to hold after the stop: press its user stop",
                      session_->scene().arms[*stopping_].name);
  }
  if (!why.empty()) throw ArmLeft(why);
  return std::exchange(track_, Track{{}, std::vector<std::vector<ArmSample>>(newest_.size())});
}

InstanceIndex ArmsRun::instance(ArmIndex arm, Law law) const {
  return session_->modes().find(name_of(session_->scene().arms[arm].name, law));
}

void ArmsRun::ask(const Request& request, ArmIndex arm, const char* what, HostTime asked) {
  const Answer answer = session_->modes().ask(request, kPatience_s, asked);
  if (!answer.accepted()) {
    throw ArmLeft(fmt::format("arm '{}': {} was refused: {}", session_->scene().arms[arm].name, what,
                              to_string(answer.verdict)));
  }
  const std::lock_guard lock(mutex_);
  answered_ = answer.cycle;
  expected_from_ = answered_ + 1;
}

void ArmsRun::lead(ArmIndex arm, Law law) {
  const InstanceIndex next = instance(arm, law);
  Request request{.kind = Request::Kind::switch_controllets};
  {
    const std::lock_guard lock(mutex_);
    const InstanceIndex before = expected_[arm];
    if (before == next) return;
    if (law == Law::hold)
      request.deactivate = bit(before);
    else
      request.activate = bit(next);
    expected_from_ = kNever;
    expected_[arm] = next;
  }
  ask(request, arm, "a switch");
}

void ArmsRun::stop(ArmIndex arm) {
  {
    const std::lock_guard lock(mutex_);
    expected_from_ = kNever;  // until the arm is in hold
    expected_[arm] = instance(arm, Law::hold);
    stopping_ = arm;
    stop_asked_ = host_now();
  }
  session_->modes().stop(ArmSet::of(arm));
}

void ArmsRun::resume(ArmIndex arm) {
  HostTime stopped_by;
  {
    const std::lock_guard lock(mutex_);
    stopped_by = stopped_by_;
  }
  ask({.kind = Request::Kind::resume, .arms = ArmSet::of(arm)}, arm, "resuming", stopped_by);
}

Request ArmsRun::goal(ArmIndex arm, Law law) const {
  return {.kind = Request::Kind::set_target, .instance = instance(arm, law)};
}

void ArmsRun::joint_goal(ArmIndex arm, const JointVector& q, double duration) {
  Request request = goal(arm, Law::joint);
  request.target.size = static_cast<std::uint8_t>(q.size());
  std::copy(q.begin(), q.end(), request.target.values.begin());
  request.target.duration_s = duration;
  ask(request, arm, "a joint goal");
}

void ArmsRun::pose_goal(ArmIndex arm, const Pose& X_WE, double duration) {
  Request request = goal(arm, Law::cartesian);
  request.target = pose_target(X_WE, duration);
  ask(request, arm, "a Cartesian goal");
}

void ArmsRun::wiggle(ArmIndex arm, std::size_t joint, double amplitude, double period_s, double cycles) {
  Request request = goal(arm, Law::joint);
  request.target.delivery = Delivery::motion;
  request.target.size = static_cast<std::uint8_t>(joint_count(arm));
  request.target.sine[joint] = amplitude;
  request.target.period_s = period_s;
  request.target.cycles = cycles;
  request.target.ramp_s = period_s;
  ask(request, arm, "a periodic motion");
}

RequestAnswer ArmsRun::request(ArmIndex arm, ArmRequest request) {
  auto answer = session_->backend().request(arm, std::move(request));
  if (answer.wait_for(std::chrono::duration<double>(kPatience_s)) != std::future_status::ready)
    return {.success = false, .reason = "no answer"};
  RequestAnswer said = answer.get();
  const std::lock_guard lock(mutex_);
  expected_from_ = cycle_ + 1000;  // from then on the arm must be back in hold
  return said;
}

}  // namespace multipanda::commission
