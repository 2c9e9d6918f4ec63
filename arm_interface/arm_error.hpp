#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace multipanda {

// The error flags of the arm's control interface, in the order of the wire: bit i of ArmState::errors.
// Only real arms raise those of Desk programs (23, 24, 33, 36 to 38), of the force controller of Desk (5) and
// of the arm's mounting (39, 40). docs/simulation.md lists the errors that a simulated arm raises.
enum class ArmError : std::uint8_t {
  joint_position_limits_violation = 0,
  cartesian_position_limits_violation,
  self_collision_avoidance_violation,
  joint_velocity_violation,
  cartesian_velocity_violation,
  force_control_safety_violation,
  joint_reflex,
  cartesian_reflex,
  max_goal_pose_deviation_violation,
  max_path_pose_deviation_violation,
  cartesian_velocity_profile_safety_violation,
  joint_position_motion_generator_start_pose_invalid,
  joint_motion_generator_position_limits_violation,
  joint_motion_generator_velocity_limits_violation,
  joint_motion_generator_velocity_discontinuity,      // the acceleration limit
  joint_motion_generator_acceleration_discontinuity,  // the jerk limit
  cartesian_position_motion_generator_start_pose_invalid,
  cartesian_motion_generator_elbow_limit_violation,
  cartesian_motion_generator_velocity_limits_violation,
  cartesian_motion_generator_velocity_discontinuity,
  cartesian_motion_generator_acceleration_discontinuity,
  cartesian_motion_generator_elbow_sign_inconsistent,
  cartesian_motion_generator_start_elbow_invalid,
  force_controller_desired_force_tolerance_violation,
  start_elbow_sign_inconsistent,
  communication_constraints_violation,
  power_limit_violation,
  cartesian_motion_generator_joint_position_limits_violation,
  cartesian_motion_generator_joint_velocity_limits_violation,
  cartesian_motion_generator_joint_velocity_discontinuity,
  cartesian_motion_generator_joint_acceleration_discontinuity,
  cartesian_position_motion_generator_invalid_frame,
  controller_torque_discontinuity,
  joint_p2p_insufficient_torque_for_planning,
  tau_j_range_violation,
  instability_detected,
  joint_move_in_wrong_direction,
  cartesian_spline_motion_generator_violation,
  joint_via_motion_generator_planning_joint_limit_violation,
  base_acceleration_initialization_timeout,
  base_acceleration_invalid_reading,
  count_
};

inline constexpr std::size_t kArmErrorCount = static_cast<std::size_t>(ArmError::count_);
static_assert(kArmErrorCount == 41);

constexpr std::uint64_t error_bit(ArmError error) {
  return std::uint64_t{1} << static_cast<std::uint8_t>(error);
}

// The violated limit of a command or measurement, with joint or axis and values.
struct ReflexDetail {
  ArmError error = ArmError::count_;  // count_: no violation
  std::int8_t index = -1;  // joint 0 to n-1, or axis x y z roll pitch yaw 0 to 5; -1: not one joint or axis
  double value = 0, limit = 0;  // SI units; `value` lies beyond `limit`
  explicit operator bool() const { return error != ArmError::count_; }
};
using Violation = ReflexDetail;

// --- Off the loop ---

// The name as libfranka prints it: "joint_reflex".
std::string_view to_string(ArmError error);
// One sentence.
std::string_view explain(ArmError error);
std::optional<ArmError> arm_error_from(std::string_view name);
// Names of the flags that are set, in the order of their bits.
std::vector<std::string> error_list(std::uint64_t errors);
// The same in one string: "joint_reflex, communication_constraints_violation"; empty if no flag is set.
std::string error_names(std::uint64_t errors, std::string_view separator = ", ");
// The sentence with joint or axis (counted from 1, as Franka does), value and limit.
std::string describe(const ReflexDetail& detail);

}  // namespace multipanda
