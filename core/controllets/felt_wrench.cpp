#include "core/controllets/felt_wrench.hpp"

#include <algorithm>
#include <numbers>

#include "core/state/external_force.hpp"

namespace multipanda {

void FeltWrench::start(const OwnedArm& arm) {
  const bool known = arm.state->tau_ext_hat.size() == arm.q().size();
  tare_ = known ? Tare::taking : Tare::moved;
  bias_ = JointVector::Zero(arm.q().size());
  age_ = summed_ = motion_n_ = 0;
  acceleration_.setZero();
  velocity_.reset(arm.terms->V_WE().linear());
}

void FeltWrench::take(const OwnedArm& arm, double dt) {
  age_ += dt;
  if (!(arm.dq().array().abs() < kRest).all()) {  // nor if one is not a number
    tare_ = Tare::moved;
  } else if (age_ > kSettling) {
    bias_ += dt * arm.state->tau_ext_hat;
    summed_ += dt;
    if (age_ < kTaking) return;
    bias_ /= summed_;
    const Wrench b = wrench_of(arm.terms->J_V_WK(), bias_);
    const bool small = (bias_.array().abs() < kMostTorque).all() && b.force().norm() < kMostForce &&
                       b.torque().norm() < kMostMoment;
    tare_ = small ? Tare::taken : Tare::too_large;
  }
}

void FeltWrench::update(const OwnedArm& arm, double dt) {
  if (waits()) take(arm, dt);
  ModelTerms& terms = *arm.terms;
  Wrench F = arm.state->F_K_W_est;
  if (waits()) F.vector *= 0;  // NaN stays NaN
  if (tare_ == Tare::taken && !F.vector.isZero(0)) {
    const Wrench b = wrench_of(terms.J_V_WK(), bias_);
    F.vector -= b.vector / std::max({1.0, b.force().norm() / kMostForce, b.torque().norm() / kMostMoment});
  }
  F_ = shifted(F, terms.X_WK().position - terms.X_WE().position).vector;
  const Vector3 v = terms.V_WE().linear(), before = velocity_.value();
  velocity_.update(v, kCutoff, dt);
  acceleration_ = 2 * std::numbers::pi * kCutoff * (v - before);
  motion_n_ = motion_of(v.norm(), acceleration_.norm());
}

}  // namespace multipanda
