#pragma once

#include "models/robot_description.hpp"

namespace multipanda {

// Limits of the control interface for commanded motion. Vectors (n x 1).
struct MotionLimits {
  JointVector q_min, q_max;  // [rad]
  JointVector dq_max;        // [rad/s]
  JointVector ddq_max;       // [rad/s^2]
  JointVector dddq_max;      // [rad/s^3]
  // Where velocity is tied to position (PositionBasedVelocity); empty: it is not tied.
  JointVector velocity_offset, deceleration;
  CartesianLimits cartesian;

  // The position limits are those of the interface, if it has any. An arm without Cartesian limits gets those
  // of the Franka Research 3.
  static MotionLimits of(const RobotDescription& robot);

  // Largest and smallest velocity of a joint at q [rad/s].
  double upper_velocity(Eigen::Index joint, double q) const;
  double lower_velocity(Eigen::Index joint, double q) const;
};

}  // namespace multipanda
