#include "runtime/embedded/arm_answer.hpp"

#include <algorithm>
#include <cmath>

#include "core/types/time.hpp"

namespace multipanda {

namespace {

FollowedMotion followed_motion(ArmDrive drive) {
  switch (drive) {
    case ArmDrive::joint_velocity:
      return FollowedMotion::joint_velocity;
    case ArmDrive::cartesian_pose:
      return FollowedMotion::cartesian_pose;
    case ArmDrive::cartesian_velocity:
      return FollowedMotion::cartesian_velocity;
    case ArmDrive::joint_position:
    case ArmDrive::none:
    case ArmDrive::effort:
      break;
  }
  return FollowedMotion::joint_position;
}

std::size_t values_of(ArmDrive drive, std::size_t joints) {
  return drive == ArmDrive::cartesian_pose ? 16 : drive == ArmDrive::cartesian_velocity ? 6 : joints;
}

}  // namespace

ArmAnswer::ArmAnswer(std::shared_ptr<const ArmModel> model, const FollowerLimits& limits, double low_pass_hz,
                     const ArmLimits* scene)
    : joints_(model->joint_count()), torque_(model, low_pass_hz, scene), follower_(limits, joints_) {
  tau_ = tau_program_ = command_.q_c = command_.dq_c = command_.tau_J_d = joint_constant(joints_, 0);
}

std::optional<ArmDrive> ArmAnswer::take_request() {
  const auto taken = request_;
  request_.reset();
  return taken;
}

void ArmAnswer::reset() {
  begin(ArmDrive::none);
  requested_ = asked_ = ArmDrive::none;
  request_.reset();
}

void ArmAnswer::request(ArmDrive drive) {
  if (asked_ == drive) return;
  request_ = asked_ = drive;
}

void ArmAnswer::begin(ArmDrive running) {
  running_ = running;
  leaving_ = follows_ = silent_ = false;
  leaving_for_ = 0;
  if (running == ArmDrive::none) return;
  if (running == ArmDrive::effort) {
    torque_.begin();
  } else {
    follower_.begin(followed_motion(running));
  }
}

ArmAnswer::Kind ArmAnswer::step(const ArmOrder& order, const ArmState& state,
                                const DesiredMotionState& desired, ArmDrive running) noexcept {
  if (order.change != change_) {
    change_ = order.change;
    requested_ = order.drive;
    number_ = 0;
  }
  if (running != running_) {
    begin(running);
    // A command from before the motion may have any age: nothing accepted commands then.
    number_ = order.number;
  }
  if (running == ArmDrive::none) {
    request(requested_);
    return Kind::none;
  }
  const bool effort = running == ArmDrive::effort;
  if (requested_ == running && order.drive == running) {
    if (leaving_) {  // selected again before the arm left the motion
      leaving_ = false;
      leaving_for_ = 0;
      effort ? torque_.resume() : follower_.resume();
    }
    request(running);
    take(order);
  }
  // A command that is not finite has cleared `requested_`.
  if (requested_ != running) {
    if (!leaving_) effort ? torque_.hold() : follower_.stop();
    leaving_ = true;
    const bool rests = effort ? torque_.is_at_rest() : leaving_for_ > 0 && follower_.is_at_rest();
    if (rests || kArmPeriod * leaving_for_ > kLongestStop) request(requested_);
    ++leaving_for_;
  }
  if (effort) {
    tau_ = torque_.step(state);
  } else {
    follower_.step(desired, command_);
  }
  follows_ = !leaving_ && (effort ? !torque_.is_holding() : follower_.follows());
  const bool was = silent_;
  silent_ = effort ? torque_.fell_silent() : follower_.is_stopped();
  if (silent_ && !was && !leaving_) ++holds_;
  return effort ? Kind::torque : Kind::motion;
}

void ArmAnswer::take(const ArmOrder& order) {
  if (order.number == number_ || order.number == 0) return;
  number_ = order.number;
  const bool effort = running_ == ArmDrive::effort;
  if (effort ? torque_.fell_silent() : follower_.is_stopped()) {
    // Commands are used again once the program has resumed.
    if (order.resumed != holds_) return;
    effort ? torque_.resume() : follower_.resume();
  }
  const std::size_t size = values_of(running_, joints_);
  const auto values = std::span(order.values).first(size);
  if (!std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); })) {
    requested_ = ArmDrive::none;
    return;
  }
  if (effort) {
    std::copy(values.begin(), values.end(), tau_program_.begin());
    torque_.take(tau_program_);
  } else {
    follower_.push(order.stamp_ns, values);
  }
}

namespace {

constexpr double kHeldStill = 0.02;   // [rad/s]
constexpr double kRateMargin = 1e-3;  // [N m/s] below the arm's rate

TorqueLimiter::Limits limits_of(const ArmModel& model, double low_pass_hz, const ArmLimits* scene) {
  ArmLimits limits = model.limits();
  if (scene != nullptr && scene->tau_max.size() == limits.tau_max.size()) {
    limits.tau_max = limits.tau_max.cwiseMin(scene->tau_max).eval();
    limits.tau_rate_max = limits.tau_rate_max.cwiseMin(scene->tau_rate_max).eval();
  }
  return {.tau_max = limits.tau_max,
          .tau_rate_max = (limits.tau_rate_max.array() - kRateMargin).matrix(),
          .low_pass_hz = low_pass_hz};
}

}  // namespace

TorqueAnswer::TorqueAnswer(const std::shared_ptr<const ArmModel>& model, double low_pass_hz,
                           const ArmLimits* scene)
    : posture_(model), limiter_(limits_of(*model, low_pass_hz, scene)) {
  tau_program_ = tau_ = joint_constant(model->joint_count(), 0);
}

void TorqueAnswer::begin() {
  limiter_.restart({});
  holding_ = false;
  resume();
  share_ = 1;
}

void TorqueAnswer::resume() {
  stopped_ = silent_ = has_torque_ = false;
  age_ = 0;
}

void TorqueAnswer::take(const JointVector& tau) {
  if (stopped_ || silent_) return;
  tau_program_ = tau;
  has_torque_ = true;
  age_ = 0;
}

const JointVector& TorqueAnswer::step(const ArmState& state) noexcept {
  if (has_torque_ && kArmPeriod * age_ > kKept) silent_ = true;
  ++age_;
  const bool hold = stopped_ || silent_ || !has_torque_;
  if (hold) {
    if (!holding_) {
      posture_.release();
      holding_ = state.q.allFinite();
      still_ = 0;
    }
    tau_ = posture_.torque(state);
    share_ = 0;
    const bool still = state.dq.allFinite() && state.dq.cwiseAbs().maxCoeff() < kHeldStill;
    still_ = still ? still_ + 1 : 0;
  } else if (share_ < 1 && holding_) {
    share_ = std::min(1.0, share_ + kArmPeriod / kFade);
    tau_ = posture_.torque(state);
    tau_ += share_ * (tau_program_ - tau_);
  } else {
    holding_ = false;
    share_ = 1;
    tau_ = tau_program_;
  }
  limiter_.observe(state.tau_J_d);
  TorqueLimiter::Cuts cuts;
  return limiter_.limit(tau_, kArmPeriod, cuts);
}

}  // namespace multipanda
