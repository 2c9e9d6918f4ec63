#pragma once

#include "models/robot_description.hpp"

namespace multipanda {

// What the arm's control interface allows of commanded motion. Vectors (n x 1).
struct MotionLimits {
  JointVector q_min, q_max;  // [rad]
  JointVector dq_max;        // [rad/s]
  JointVector ddq_max;       // [rad/s^2]
  JointVector dddq_max;      // [rad/s^3]
  // Where velocity is tied to position (PositionBasedVelocity); empty: it is not.
  JointVector velocity_offset, deceleration;
  CartesianLimits cartesian;

  // The position limits are the interface's own, where it has some. An arm without Cartesian figures gets
  // those of the Franka Research 3.
  static MotionLimits of(const RobotDescription& robot);

  // Greatest and least velocity of a joint at q [rad/s].
  double upper_velocity(Eigen::Index joint, double q) const;
  double lower_velocity(Eigen::Index joint, double q) const;
};

}  // namespace multipanda
