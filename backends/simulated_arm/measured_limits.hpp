#pragma once

#include <cstdint>
#include <optional>

#include "backends/simulated_arm/motion_limits.hpp"
#include "core/safety/safety.hpp"
#include "core/types/spatial.hpp"
#include "device/arm_error.hpp"

namespace multipanda {

// The arm's checks of its measurements during a motion:
//
//   q beyond the interface's position limits             joint_position_limits_violation
//   |dq| beyond kVelocityMargin times the limit          joint_velocity_violation
//   |tau_J| beyond the torque limit, gravity included    tau_j_range_violation
//   sum |tau_J dq| beyond the largest power              power_limit_violation
//   end effector outside the workspace, if there is one  cartesian_position_limits_violation
//   |v|, |w| of it beyond kVelocityMargin times limit    cartesian_velocity_violation, in Cartesian motion:
//                                                        joint 7 may turn faster than a hand
//
// The margin allows the overshoot of following a motion at the limit. A joint that starts beyond its limit
// may return: its limit is then its start position.
class MeasuredLimits {
 public:
  static constexpr double kVelocityMargin = 1.1;
  // Of tau_max times dq_max, summed over the joints: 425 W for a Panda. Not a published figure.
  static constexpr double kPowerShare = 0.5;
  static constexpr double kLeadBack = 0.02;  // how far a joint may continue outwards from there [rad]

  // tau_max (n x 1) [N m]; workspace in the base, of the end effector's origin.
  MeasuredLimits(MotionLimits limits, const JointVector& tau_max, std::optional<WorkspaceBox> workspace);

  // Starts at q (n x 1), which may be beyond the limits.
  void stand_at(const JointVector& q);

  struct Measured {
    const JointVector &q, &dq, &tau_J;
    const Vector3& p_BE;
    const Vector6& V_BE;
    bool cartesian_motion;
  };
  // The first violated rule in the order above, with the worst joint or axis. Loop thread.
  ReflexDetail check(const Measured& measured);

  double power_max() const { return power_max_; }

 private:
  MotionLimits limits_;
  JointVector tau_max_;
  std::optional<WorkspaceBox> workspace_;
  double power_max_ = 0;
  JointVector q_min_, q_max_;  // the current limits
};

}  // namespace multipanda
