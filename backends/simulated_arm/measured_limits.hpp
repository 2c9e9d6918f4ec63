#pragma once

#include <cstdint>
#include <optional>

#include "arm_interface/arm_error.hpp"
#include "core/safety/safety.hpp"
#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"
#include "models/robot_description.hpp"

namespace multipanda {

// Limits of the control interface for commanded motion. Vectors (n x 1).
struct MotionLimits {
  JointVector q_min, q_max;  // [rad]
  JointVector dq_max;        // [rad/s]
  JointVector ddq_max;       // [rad/s^2]
  JointVector dddq_max;      // [rad/s^3]
  // Velocity limits that depend on position (PositionBasedVelocity); empty: none.
  JointVector velocity_offset, deceleration;
  CartesianLimits cartesian;

  // The position limits are those of the interface, if it has any. An arm without Cartesian limits gets those
  // of the Franka Research 3.
  static MotionLimits of(const RobotDescription& robot);

  // Largest and smallest velocity of a joint at q [rad/s].
  double upper_velocity(Eigen::Index joint, double q) const;
  double lower_velocity(Eigen::Index joint, double q) const;
};

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
// The margin allows for overshoot when following a motion at the limit. A joint that starts beyond its limit
// may return: the limit is then its start position.
class MeasuredLimits {
 public:
  static constexpr double kVelocityMargin = 1.1;
  // Of tau_max times dq_max, summed over the joints: 425 W for a Panda. Not a published figure.
  static constexpr double kPowerShare = 0.5;
  static constexpr double kLeadBack = 0.02;  // how far such a joint may still move outwards [rad]

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
  // The first violated rule in the above order, with the worst joint or axis. Loop thread.
  ReflexDetail check(const Measured& measured);

  double power_max() const { return power_max_; }

 private:
  MotionLimits limits_;
  JointVector tau_max_;
  std::optional<WorkspaceBox> workspace_;
  double power_max_ = 0;
  JointVector q_min_, q_max_;  // the current limits
};

// The arm's check of commanded torques: each joint's torque may change by at most rate_max per second, over
// one period. The change is counted from the last command and from the torque that the arm last published in
// single precision, because a client only knows the latter (at 87 N m one ulp is 8 N m/s at 1 kHz). A torque
// is refused only if it is too far from both. A motion begins at 0, as Franka documents it, or at the torque
// in use that the arm published; with begin(X) only at the latter.
class TorqueRateCheck {
 public:
  static constexpr double kSlack = 1e-5;  // relative

  // rate_max (n x 1) [N m/s].
  TorqueRateCheck(const JointVector& rate_max, double period_s);

  void begin() { begin(JointVector::Zero(last_.size())); }
  void begin(const JointVector& tau) { last_ = replaced_ = tau; }
  // The joint with the largest violation, and its rate [N m/s]; or nothing.
  ReflexDetail check(const JointVector& tau) const;
  void accept(const JointVector& tau) { last_ = replaced_ = tau; }
  // Until accept(): a torque that passed the check but is replaced by another one of the same period.
  void replace(const JointVector& tau) { replaced_ = tau; }
  void publish(const JointVector& tau_J_d) { published_ = tau_J_d.cast<float>().cast<double>(); }

 private:
  JointVector rate_max_, last_, replaced_, published_;
  double period_;
};

}  // namespace multipanda
