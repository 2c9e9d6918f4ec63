#include "runtime/embedded/torque_answer.hpp"

#include <algorithm>

#include "core/types/time.hpp"

namespace multipanda {
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
