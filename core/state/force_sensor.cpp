#include "core/state/force_sensor.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "core/state/load_ramp.hpp"

namespace multipanda {
namespace {

// The weight of a load, about S, axes of S.
Wrench weight_of(const Load& load, const Pose& X_FS, const Matrix3& R_WS) {
  Wrench weight;
  weight.force() = load.mass * (R_WS.transpose() * Vector3(0, 0, -9.81));  // [m/s^2]
  weight.torque() = (X_FS.inverse() * load.p_FC).cross(Vector3(weight.force()));
  return weight;
}

// The largest torque of a joint that turns; none if a torque is missing or not a number [N m].
double largest(const JointVector& tau, const Jacobian& J) {
  if (tau.size() != J.cols() || !tau.allFinite()) return 0;
  double most = 0;
  for (Eigen::Index i = 0; i < tau.size(); ++i) {
    if (J.col(i).tail<3>().squaredNorm() > 0.5) most = std::max(most, std::abs(tau[i]));
  }
  return most;
}

}  // namespace

SensedForce::SensedForce(const ForceSensorMount& mount) : mount_(mount) {
  const auto positive = [](double x) { return x > 0 && x < std::numeric_limits<double>::infinity(); };
  if (!mount.X_FS.position.allFinite() || !mount.X_FS.rotation.isUnitary(1e-6) ||
      !mount.carried.p_FC.allFinite() || !(mount.carried.mass >= 0) || !positive(mount.carried.mass + 1) ||
      !positive(mount.range_n) || !positive(mount.range_nm) || !positive(mount.max_age_s))
    throw std::invalid_argument(
        "a force sensor needs a pose, a mass of at least 0, and ranges and an age above 0");
}

SensorFault SensedForce::fault_of(const ForceReading& reading) const {
  if (reading.records == 0 || !(reading.age_s <= mount_.max_age_s))
    return {Intervention::force_sensor_silent, reading.age_s, mount_.max_age_s};
  const double force = reading.F_S.force().cwiseAbs().maxCoeff();
  const double moment = reading.F_S.torque().cwiseAbs().maxCoeff();
  if (reading.fault != Intervention::none) return {reading.fault, force, mount_.range_n};
  if (!reading.F_S.vector.allFinite()) return {Intervention::force_sensor_fault};
  if (force > mount_.range_n) return {Intervention::force_sensor_saturated, force, mount_.range_n};
  if (moment > mount_.range_nm) return {Intervention::force_sensor_saturated, moment, mount_.range_nm};
  return {};
}

SensorFault SensedForce::take(const Wrench& bias, double felt) {
  constexpr auto kNot = Intervention::force_sensor_not_tared;
  const double force = bias.force().norm(), moment = bias.torque().norm();
  if (rested_ < 2 * kTareTime) return {kNot, force, kMostForce};
  if (!(force <= kMostForce)) return {kNot, force, kMostForce};
  if (!(moment <= kMostMoment)) return {kNot, moment, kMostMoment};
  if (felt > kMostFelt) return {kNot, felt, kMostFelt};
  bias_ = bias;
  tared_ = true;
  return {};
}

SensorFault SensedForce::update(const ForceReading& reading, const Place& place, double dt, ArmState& state) {
  const Pose X_WS = place.X_WF * mount_.X_FS;
  const Load carried = combined(mount_.carried, 1, state.load, 1);
  const Wrench weight = weight_of(carried, mount_.X_FS, X_WS.rotation);
  rested_ = (state.dq.array().abs() < kRest).all() ? rested_ + dt : 0.0;
  const JointVector own = state.tau_ext_hat;
  SensorFault fault = fault_of(reading);
  if (fault.rule == Intervention::none && !tared_)
    fault = take({reading.mean_S.vector - weight.vector}, largest(own, place.J_V_WK));
  Wrench F;  // on the environment, about S, world axes
  const Vector6 F_S = bias_.vector + weight.vector - reading.F_S.vector;
  F.force() = X_WS.rotation * F_S.head<3>();
  F.torque() = X_WS.rotation * F_S.tail<3>();
  state.F_K_W_est = shifted(F, X_WS.position - place.p_WK);
  state.tau_ext_hat = place.J_V_WK.transpose().lazyProduct(state.F_K_W_est.vector);
  if (fault.rule == Intervention::none && own.size() == state.tau_ext_hat.size()) {
    const double difference = largest(own - state.tau_ext_hat, place.J_V_WK);
    contradicted_ = difference > kMostDifference ? contradicted_ + dt : 0;
    if (contradicted_ > kDoubt)
      fault = {Intervention::force_sensor_contradicted, difference, kMostDifference};
  }
  state.has_wrench_estimate = fault.rule == Intervention::none;
  if (!state.has_wrench_estimate) {
    state.F_K_W_est.vector.setConstant(std::numeric_limits<double>::quiet_NaN());
    state.tau_ext_hat.setConstant(std::numeric_limits<double>::quiet_NaN());
  }
  return fault;
}

}  // namespace multipanda
