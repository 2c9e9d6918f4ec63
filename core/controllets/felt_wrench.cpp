#include "core/controllets/felt_wrench.hpp"

#include <numbers>

#include "core/state/external_force.hpp"

namespace multipanda {

void FeltWrench::start(const OwnedArm& arm) {
  const bool known = arm.state->tau_ext_hat.size() == arm.q().size();
  tare_ = known ? Tare::taking : Tare::moved;
  bias_ = JointVector::Zero(arm.q().size());
  age_ = summed_ = motion_n_ = 0;
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
    const bool small = (bias_.array().abs() < kMostTorque).all() &&
                       wrench_of(arm.terms->J_V_WK(), bias_).force().norm() < kMostForce;
    tare_ = small ? Tare::taken : Tare::too_large;
  }
}

void FeltWrench::update(const OwnedArm& arm, double dt) {
  if (waits()) take(arm, dt);
  ModelTerms& terms = *arm.terms;
  Wrench F = arm.state->F_K_W_est;
  if (tare_ == Tare::taken) F.vector -= wrench_of(terms.J_V_WK(), bias_).vector;
  F_ = shifted(F, terms.X_WK().position - terms.X_WE().position).vector;
  const Vector3 v = terms.V_WE().linear(), before = velocity_.value();
  velocity_.update(v, kCutoff, dt);
  motion_n_ = kPerSpeed * v.norm() + kPerAcceleration * 2 * std::numbers::pi * kCutoff * (v - before).norm();
}

}  // namespace multipanda
