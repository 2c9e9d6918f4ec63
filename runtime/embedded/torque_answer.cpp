#include "runtime/embedded/torque_answer.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/controllets/damping_design.hpp"
#include "core/types/time.hpp"

namespace multipanda {
namespace {

// As the controllet `hold` has it.
constexpr std::array<double, 7> kHoldStiffness{300, 300, 300, 300, 120, 80, 40};  // [N m/rad]
constexpr double kHoldDamping = 1;
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

TorqueAnswer::TorqueAnswer(std::shared_ptr<const ArmModel> model, double low_pass_hz, const ArmLimits* scene)
    : terms_(std::move(model)),
      limiter_(limits_of(terms_.model(), low_pass_hz, scene)),
      stiffness_(joint_constant(terms_.joint_count(), kHoldStiffness.back())) {
  for (Eigen::Index i = 0; i < stiffness_.size() && i < static_cast<Eigen::Index>(kHoldStiffness.size());
       ++i) {
    stiffness_[i] = kHoldStiffness[static_cast<std::size_t>(i)];
  }
  damped_ = tau_program_ = tau_ = joint_constant(terms_.joint_count(), 0);
  q_0_ = terms_.model().q_home();
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
      holding_ = state.q.allFinite();
      q_0_ = state.q;
      still_ = 0;
    }
    tau_ = spring(state);
    share_ = 0;
    const bool still = state.dq.allFinite() && state.dq.cwiseAbs().maxCoeff() < kHeldStill;
    still_ = still ? still_ + 1 : 0;
  } else if (share_ < 1 && holding_) {
    share_ = std::min(1.0, share_ + kArmPeriod / kFade);
    tau_ = spring(state);
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

const JointVector& TorqueAnswer::spring(const ArmState& state) {
  if (!holding_ || !state.q.allFinite() || !state.dq.allFinite()) {
    damped_.setZero();  // no usable measurement: the arm compensates its gravity
    return damped_;
  }
  terms_.update(state);
  const JointMatrix D = joint_damping(terms_.M(), stiffness_, kHoldDamping);
  damped_ = stiffness_.cwiseProduct(q_0_ - state.q) - D.lazyProduct(state.dq) + terms_.c();
  return damped_;
}

}  // namespace multipanda
