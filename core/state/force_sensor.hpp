#pragma once

#include "core/state/arm_state.hpp"
#include "core/types/codes.hpp"

namespace multipanda {

// What a force and torque sensor on the flange measured last. S is its frame.
struct ForceReading {
  std::uint64_t records = 0;  // received so far; 0: none yet
  double age_s = 0;           // of the last one
  Wrench F_S;                 // load on the side of the tool, about S, axes of S: gravity pulls along itself
  Wrench mean_S;              // over the last full SensedForce::kTareTime
  Intervention fault = Intervention::none;
};

// How a force sensor is mounted, and what it bears.
struct ForceSensorMount {
  Pose X_FS;                              // in the flange
  Load carried;                           // besides the declared payload; in the flange
  double range_n = 1000, range_nm = 100;  // of each axis: beyond it the sensor is saturated
  double max_age_s = 0.01;
};

// Why a force sensor is not to be believed (none: it is), and the figures of that rule.
struct SensorFault {
  Intervention rule = Intervention::none;
  double value = 0, limit = 0;
};

// The wrench that an arm exerts on its environment, from a sensor between flange and tool:
//   F_on_arm = F_S - bias - weight,   weight = m [R^T g; c x R^T g]   about S, axes of S
//   F_hat_K = -F_on_arm, moved from S to K, in world axes;   tau_ext_hat = J_K^T F_hat_K
// m and c are those of `carried` and the declared payload; their inertia when the arm accelerates is not
// compensated. The bias is what remains when the arm is at rest and free: taken once, at the first rest, if
// it is no more than kMostForce and kMostMoment, and the arm itself feels no more than kMostFelt; more is a
// contact or a wrong `carried`.
//
// The arm's own estimate knows nothing of the sensor's mount, signs, units, address, or of a bias taken
// during the run: if the joint torques differ by more than kMostDifference for kDoubt,
// one of them is wrong, or something else than the tool is pushed. A sensor that shows nothing, or the other
// way, thus ends a press at 20 to 40 N. Prismatic joints do not count: their own friction is of that size.
//
// With a fault, the wrench is unknown: has_wrench_estimate is false, and the numbers are NaN, so that laws
// that need them end.
class SensedForce {
 public:
  static constexpr double kTareTime = 0.2;                       // [s]
  static constexpr double kRest = 0.02;                          // [rad/s]
  static constexpr double kMostForce = 30.0, kMostMoment = 3.0;  // [N], [N m]
  // Arms at rest estimate up to 0.75 N m per joint of their own (docs/forces.md), in motion 20 N at the hand.
  static constexpr double kMostFelt = 4.0, kMostDifference = 10.0;  // [N m]
  static constexpr double kDoubt = 0.2;                             // [s]

  // Throws std::invalid_argument if a value is not finite or out of range.
  explicit SensedForce(const ForceSensorMount& mount);

  struct Place {
    Pose X_WF;
    Vector3 p_WK;
    const Jacobian& J_V_WK;  // at K, world axes (6 x n)
  };
  // For every packet of the arm, whose tau_ext_hat is its own estimate, or empty. `dt`: of the loop's step.
  // Fills tau_ext_hat, F_K_W_est, has_wrench_estimate. Loop thread, no allocation.
  SensorFault update(const ForceReading& reading, const Place& place, double dt, ArmState& state);

 private:
  SensorFault fault_of(const ForceReading& reading) const;
  SensorFault take(const Wrench& bias, double felt);

  ForceSensorMount mount_;
  Wrench bias_;  // about S, axes of S
  bool tared_ = false;
  // At rest [s]. An arm rests before its loop begins. The mean may have begun before the rest.
  double rested_ = 2 * kTareTime;
  double contradicted_ = 0;  // by the arm's own estimate [s]
};

}  // namespace multipanda
