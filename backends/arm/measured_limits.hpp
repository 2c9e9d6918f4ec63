#pragma once

#include <cstdint>
#include <optional>

#include "backends/arm/arm_error.hpp"
#include "backends/arm/motion_limits.hpp"
#include "core/safety/safety.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

// What the arm checks of its own measurements while it moves, whatever was commanded:
//
//   q beyond the interface's position limits             joint_position_limits_violation
//   |dq| beyond kVelocityMargin times the limit          joint_velocity_violation
//   |tau_J| beyond the torque limit, gravity included    tau_j_range_violation
//   sum |tau_J dq| beyond the greatest power             power_limit_violation
//   end effector outside the workspace, if there is one  cartesian_position_limits_violation
//   |v|, |w| of it beyond kVelocityMargin times limit    cartesian_velocity_violation, in Cartesian motion:
//                                                        joint 7 may turn faster than a hand
//
// The margin lets a motion that is commanded at the limit overshoot by what following it needs. A joint that
// is beyond its limit when the arm takes commands again may be led back: it is watched from there.
class MeasuredLimits {
 public:
  static constexpr double kVelocityMargin = 1.1;
  // Of tau_max times dq_max, summed over the joints: 425 W for a Panda. No maker's figure.
  static constexpr double kPowerShare = 0.5;
  static constexpr double kLeadBack = 0.02;  // as far as a joint may go on outwards from there [rad]

  // tau_max (n x 1) [N m]; workspace in the base, of the end effector's origin.
  MeasuredLimits(MotionLimits limits, const JointVector& tau_max, std::optional<WorkspaceBox> workspace);

  // Beyond its limits q (n x 1) is where the arm stands now.
  void stand_at(const JointVector& q);

  struct Measured {
    const JointVector &q, &dq, &tau_J;
    const Vector3& p_BE;
    const Vector6& V_BE;
    bool cartesian_motion;
  };
  // The first rule broken, in the order above; the joint or axis that breaks it by most. Loop thread.
  ReflexDetail check(const Measured& measured);

  double power_max() const { return power_max_; }

 private:
  MotionLimits limits_;
  JointVector tau_max_;
  std::optional<WorkspaceBox> workspace_;
  double power_max_ = 0;
  JointVector q_min_, q_max_;  // as watched now
};

}  // namespace multipanda
