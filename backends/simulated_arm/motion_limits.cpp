#include "backends/simulated_arm/motion_limits.hpp"

#include <algorithm>
#include <cmath>

namespace multipanda {

MotionLimits MotionLimits::of(const RobotDescription& robot) {
  MotionLimits limits;
  const JointLimits& joints = robot.limits;
  limits.q_min = joints.q_min;
  limits.q_max = joints.q_max;
  limits.dq_max = joints.dq_max;
  limits.ddq_max = joints.ddq_max;
  limits.dddq_max = joints.dddq_max;
  if (const auto& tied = robot.position_based_velocity) {
    limits.q_min = tied->q_min;
    limits.q_max = tied->q_max;
    limits.velocity_offset = tied->offset;
    limits.deceleration = tied->deceleration;
  }
  limits.cartesian = robot.cartesian.value_or(CartesianLimits{.velocity = 3.0,
                                                              .acceleration = 9.0,
                                                              .jerk = 4500,
                                                              .rotation_velocity = 2.5,
                                                              .rotation_acceleration = 17,
                                                              .rotation_jerk = 8500,
                                                              .elbow_velocity = 1.5,
                                                              .elbow_acceleration = 10,
                                                              .elbow_jerk = 5000});
  return limits;
}

double MotionLimits::upper_velocity(Eigen::Index joint, double q) const {
  if (velocity_offset.size() == 0) return dq_max[joint];
  const double room = std::max(0.0, 2 * deceleration[joint] * (q_max[joint] - q));
  return std::min(dq_max[joint], std::max(0.0, std::sqrt(room) - velocity_offset[joint]));
}

double MotionLimits::lower_velocity(Eigen::Index joint, double q) const {
  if (velocity_offset.size() == 0) return -dq_max[joint];
  const double room = std::max(0.0, 2 * deceleration[joint] * (q - q_min[joint]));
  return -std::min(dq_max[joint], std::max(0.0, std::sqrt(room) - velocity_offset[joint]));
}

}  // namespace multipanda
