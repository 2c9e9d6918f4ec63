#include "backends/simulated_arm/contact_monitor.hpp"

#include <cmath>
#include <numbers>

#include "core/types/triangular.hpp"

namespace multipanda {
namespace {

// 1/tr((J J^T)^-1); 0: singular.
double distance_from_singularity(const Jacobian& J) {
  Matrix6 JJt = Matrix6::Zero();
  for (Eigen::Index i = 0; i < J.cols(); ++i) {
    const Vector6 column = J.col(i);
    JJt.noalias() += column * column.transpose();
  }
  Matrix6 L, inverse_root = Matrix6::Identity();
  if (!cholesky_factor(JJt, L)) return 0;
  divide_by_transposed_lower(L, inverse_root);  // tr(A^-1) = |L^-1|^2
  const double trace = inverse_root.squaredNorm();
  return std::isfinite(trace) ? 1 / trace : 0;
}

// Marks values above the lower and upper thresholds, and keeps the largest excess over the upper one.
template <typename Vector>
void compare(const Vector& value, const Vector& lower, const Vector& upper, ArmError error, Vector& contact,
             Vector& above, ReflexDetail& collision) {
  collision = {};
  double excess = 0;
  for (Eigen::Index i = 0; i < value.size(); ++i) {
    const double size = std::abs(value[i]);
    contact[i] = size > lower[i] ? 1 : 0;
    above[i] = size > upper[i] ? 1 : 0;
    if (size <= upper[i] || size - upper[i] <= excess) continue;
    excess = size - upper[i];
    collision = {.error = error, .index = static_cast<std::int8_t>(i), .value = value[i], .limit = upper[i]};
  }
}

}  // namespace

ContactMonitor::ContactMonitor(std::size_t joint_count, bool as_real, const MassExcess& hand)
    : as_real_(as_real),
      hand_(hand),
      observer_(joint_count, as_real ? kRealFirst : ExternalForceObserver::kBandwidth) {
  estimate_.tau_ext_hat = joint_constant(joint_count, 0);
  second_stage_ = estimate_.tau_J = dq_slow_ = joint_contact_ = joint_above_ = estimate_.tau_ext_hat;
}

void ContactMonitor::reset() {
  observer_.reset();
  second_stage_.setZero();
  estimate_.tau_ext_hat.setZero();
  F_K_W_ = F_K_K_ = {};
  begun_ = accelerating_ = false;
  joint_contact_.setZero();
  joint_above_.setZero();
  cartesian_contact_.setZero();
  cartesian_above_.setZero();
  joint_collision_ = cartesian_collision_ = {};
}

// The torque that supports the hand's declared excess.
JointVector ContactMonitor::excess_weight(ModelTerms& terms, const Jacobian& J_V_WK) const {
  constexpr double kGravity = 9.81;
  const Vector3 weight(0, 0, -kGravity);
  const Pose &X_WF = terms.X_WF(), &X_WK = terms.X_WK();
  const Vector3 moment_K = X_WF.rotation * hand_.moment - hand_.mass * (X_WK.position - X_WF.position);
  Vector6 F_K_W;
  F_K_W << hand_.mass * weight, moment_K.cross(weight);
  return -J_V_WK.transpose().lazyProduct(F_K_W);
}

void ContactMonitor::sense(ModelTerms& terms, const ArmState& state, double dt) {
  estimate_.t_robot = state.t_robot;
  estimate_.config_version = state.config_version;
  estimate_.tau_J = state.tau_J;
  const Jacobian J_V_WK = terms.J_V_WK();
  observer_.update({terms.momentum(), terms.momentum_drift(), J_V_WK}, estimate_);
  if (as_real_) {
    const double rate = -std::expm1(-2 * std::numbers::pi * kRealSecond * dt);
    estimate_.tau_ext_hat -= excess_weight(terms, J_V_WK);
    second_stage_ += rate * (estimate_.tau_ext_hat - second_stage_);
    estimate_.tau_ext_hat = second_stage_;
    estimate_.F_K_W_est = wrench_of(J_V_WK, second_stage_);
  }
  if (distance_from_singularity(J_V_WK) < kSingular) {
    F_K_W_ = F_K_K_ = {};
    return;
  }
  F_K_W_ = estimate_.F_K_W_est;
  const Matrix3& R_WK = terms.X_WK().rotation;
  F_K_K_.force() = R_WK.transpose() * F_K_W_.force();
  F_K_K_.torque() = R_WK.transpose() * F_K_W_.torque();
}

void ContactMonitor::update(ModelTerms& terms, const ArmState& state, const JointVector& desired_ddq,
                            double dt, const SetCollisionThresholds& thresholds) {
  sense(terms, state, dt);
  if (!begun_) dq_slow_ = state.dq;
  begun_ = true;
  const double rate = 1 - std::exp(-kRateFilter * dt);
  dq_slow_ += rate * (state.dq - dq_slow_);
  const double acceleration = desired_ddq.size() > 0
                                  ? desired_ddq.cwiseAbs().maxCoeff()
                                  : kRateFilter * (state.dq - dq_slow_).cwiseAbs().maxCoeff();
  accelerating_ = acceleration > kAccelerating;
  const ContactThresholds& limit =
      accelerating_ && thresholds.acceleration ? *thresholds.acceleration : thresholds.nominal;
  compare(estimate_.tau_ext_hat, limit.torque_lower, limit.torque_upper, ArmError::joint_reflex,
          joint_contact_, joint_above_, joint_collision_);
  compare(F_K_K_.vector, limit.wrench_lower, limit.wrench_upper, ArmError::cartesian_reflex,
          cartesian_contact_, cartesian_above_, cartesian_collision_);
}

}  // namespace multipanda
