#include "core/controllets/felt_wrench.hpp"

#include <algorithm>
#include <numbers>

#include "core/state/external_force.hpp"
#include "core/state/load_ramp.hpp"

namespace multipanda {
namespace {

Eigen::Vector4d weight_of(const ArmState& state) {
  Eigen::Vector4d weight;
  weight << state.tool.mass + state.load.mass,
      state.tool.mass * state.tool.p_FC + state.load.mass * state.load.p_FC;
  return weight;
}

}  // namespace

void FeltWrench::start(const OwnedArm& arm) {
  known_ = arm.state->tau_ext_hat.size() == arm.q().size();
  tare_ = known_ ? Tare::taking : Tare::moved;
  bias_ = mean_ = JointVector::Zero(arm.q().size());
  rested_ = summed_ = motion_n_ = doubt_n_ = doubt_nm_ = 0;
  config_version_ = arm.state->config_version;
  weight_ = weight_of(*arm.state);
  acceleration_.setZero();
  velocity_.reset(arm.terms->V_WE().linear());
}

void FeltWrench::watch_load(const ArmState& state) {
  config_version_ = state.config_version;
  const Eigen::Vector4d weight = weight_of(state);
  if (weight == weight_) return;
  weight_ = weight;
  tare_ = Tare::moved;
  rested_ = -LoadRamp::kDuration;
}

void FeltWrench::take(const OwnedArm& arm, bool touches, double dt) {
  rested_ += dt;
  if (touches || !(arm.dq().array().abs() < kRest).all()) {  // nor if one is not a number
    if (waits()) tare_ = Tare::moved;
    rested_ = std::min(rested_, 0.0);
  } else if (rested_ > kSettling) {
    mean_ += dt * arm.state->tau_ext_hat;
    summed_ += dt;
    if (rested_ < kTaking) return;
    mean_ /= summed_;
    const Wrench b = wrench_of(arm.terms->J_V_WK(), mean_);
    const bool small = (mean_.array().abs() < kMostTorque).all() && b.force().norm() < kMostForce &&
                       b.torque().norm() < kMostMoment;
    tare_ = small ? Tare::taken : Tare::too_large;
    if (small) bias_ = mean_;
    rested_ = 0;
  }
  if (rested_ <= 0) {
    mean_.setZero();
    summed_ = 0;
  }
}

void FeltWrench::update(const OwnedArm& arm, bool touches, double dt) {
  if (known_ && arm.state->config_version != config_version_) watch_load(*arm.state);
  if (known_ && tare_ != Tare::taken) take(arm, touches, dt);
  ModelTerms& terms = *arm.terms;
  Wrench F = arm.state->F_K_W_est, off;
  if (waits()) F.vector *= 0;  // NaN stays NaN
  if (!bias_.isZero(0) && !F.vector.isZero(0)) {
    off = wrench_of(terms.J_V_WK(), bias_);
    off.vector /= std::max({1.0, off.force().norm() / kMostForce, off.torque().norm() / kMostMoment});
    F.vector -= off.vector;
  }
  const bool doubtful = known_ && !waits() && tare_ != Tare::taken;
  doubt_n_ = doubtful ? kMostForce + off.force().norm() : 0;
  doubt_nm_ = doubtful ? kMostMoment + off.torque().norm() : 0;
  F_ = shifted(F, terms.X_WK().position - terms.X_WE().position).vector;
  const Vector3 v = terms.V_WE().linear(), before = velocity_.value();
  velocity_.update(v, kCutoff, dt);
  acceleration_ = 2 * std::numbers::pi * kCutoff * (v - before);
  motion_n_ = motion_of(v.norm(), acceleration_.norm());
}

}  // namespace multipanda
