#include "arm_interface/arm_error.hpp"

#include <array>
#include <cstdio>

namespace multipanda {
namespace {

// Meaning of an index, and the unit of value and limit.
enum class About : std::uint8_t { nothing, joint, axis };
struct Text {
  const char* name;
  const char* sentence;
  About about = About::nothing;
  const char* unit = "";
};

constexpr std::array<Text, kArmErrorCount> kTexts{{
    {"joint_position_limits_violation", "A joint was measured beyond its position limit.", About::joint,
     "rad"},
    {"cartesian_position_limits_violation", "The end effector was measured outside its workspace.",
     About::axis, "m"},
    {"self_collision_avoidance_violation", "Two parts of the arm came too close to each other.",
     About::nothing, "m"},
    {"joint_velocity_violation", "A joint was measured faster than its velocity limit.", About::joint,
     "rad/s"},
    {"cartesian_velocity_violation", "The end effector was measured faster than its velocity limit.",
     About::axis, "m/s or rad/s"},
    {"force_control_safety_violation", "The arm's own force controller exceeded its safety limits."},
    {"joint_reflex", "The external torque on a joint exceeded its upper collision threshold.", About::joint,
     "N m"},
    {"cartesian_reflex", "The external force or torque exceeded its upper collision threshold.", About::axis,
     "N or N m"},
    {"max_goal_pose_deviation_violation", "The arm ended its motion too far from the goal."},
    {"max_path_pose_deviation_violation", "The arm deviated too far from the path of its motion."},
    {"cartesian_velocity_profile_safety_violation",
     "The arm deviated too far from the Cartesian velocity profile of its motion."},
    {"joint_position_motion_generator_start_pose_invalid",
     "The first commanded joint position does not match the arm's current position.", About::joint, "rad"},
    {"joint_motion_generator_position_limits_violation", "A commanded joint position is beyond its limit.",
     About::joint, "rad"},
    {"joint_motion_generator_velocity_limits_violation",
     "The commanded joint motion is faster than its velocity limit.", About::joint, "rad/s"},
    {"joint_motion_generator_velocity_discontinuity",
     "The commanded joint velocity jumped: more than the acceleration limit allows in one period.",
     About::joint, "rad/s^2"},
    {"joint_motion_generator_acceleration_discontinuity",
     "The commanded joint acceleration jumped: more than the jerk limit allows in one period.", About::joint,
     "rad/s^3"},
    {"cartesian_position_motion_generator_start_pose_invalid",
     "The first commanded pose does not match the end effector's current pose.", About::axis, "m or rad"},
    {"cartesian_motion_generator_elbow_limit_violation",
     "The commanded elbow exceeds its position or velocity limit.", About::nothing, "rad"},
    {"cartesian_motion_generator_velocity_limits_violation",
     "The commanded Cartesian motion is faster than its velocity limit.", About::axis, "m/s or rad/s"},
    {"cartesian_motion_generator_velocity_discontinuity",
     "The commanded Cartesian velocity jumped: more than the acceleration limit allows in one period.",
     About::axis, "m/s^2 or rad/s^2"},
    {"cartesian_motion_generator_acceleration_discontinuity",
     "The commanded Cartesian acceleration jumped: more than the jerk limit allows in one period.",
     About::axis, "m/s^3 or rad/s^3"},
    {"cartesian_motion_generator_elbow_sign_inconsistent",
     "The commanded elbow and the arm's elbow are on opposite sides of joint 4."},
    {"cartesian_motion_generator_start_elbow_invalid",
     "The first commanded elbow does not match the arm's current elbow.", About::nothing, "rad"},
    {"force_controller_desired_force_tolerance_violation",
     "The arm's own force controller deviated too far from its desired force."},
    {"start_elbow_sign_inconsistent", "A Desk motion starts with the elbow on the other side."},
    {"communication_constraints_violation",
     "Too many commands in a row were missing or too late: the program, its computer or the network was too "
     "slow.",
     About::nothing, "commands"},
    {"power_limit_violation", "The arm's mechanical power exceeded its limit.", About::nothing, "W"},
    {"cartesian_motion_generator_joint_position_limits_violation",
     "The commanded Cartesian motion moves a joint beyond its position limit.", About::joint, "rad"},
    {"cartesian_motion_generator_joint_velocity_limits_violation",
     "The commanded Cartesian motion needs a joint faster than its velocity limit.", About::joint, "rad/s"},
    {"cartesian_motion_generator_joint_velocity_discontinuity",
     "The commanded Cartesian motion needs a joint acceleration beyond its limit.", About::joint, "rad/s^2"},
    {"cartesian_motion_generator_joint_acceleration_discontinuity",
     "The commanded Cartesian motion needs a joint jerk beyond its limit.", About::joint, "rad/s^3"},
    {"cartesian_position_motion_generator_invalid_frame_flag",
     "The commanded pose is not a rigid transform: its rotation is not orthonormal."},
    {"controller_torque_discontinuity",
     "The commanded torque jumped by more than the torque rate limit allows in one period, or was not a "
     "finite number.",
     About::joint, "N m/s"},
    {"joint_p2p_insufficient_torque_for_planning",
     "A Desk motion could not be planned with the remaining torque."},
    {"tau_J_range_violation", "The torque measured in a joint is out of range.", About::joint, "N m"},
    {"instability_detected", "The arm's own controller became unstable."},
    {"joint_move_in_wrong_direction", "A joint beyond its limit was moved farther outwards.", About::joint,
     "rad"},
    {"cartesian_spline_motion_generator_violation", "A spline motion exceeded its limits."},
    {"joint_via_motion_generator_planning_joint_limit_violation",
     "A planned joint motion would exceed a joint limit.", About::joint, "rad"},
    {"base_acceleration_initialization_timeout",
     "The acceleration of the arm's base was not measured in time."},
    {"base_acceleration_invalid_reading", "The measured acceleration of the arm's base is implausible."},
}};

const char* axis_name(int axis) {
  static constexpr std::array<const char*, 6> kNames{"x", "y", "z", "roll", "pitch", "yaw"};
  return axis >= 0 && axis < 6 ? kNames[static_cast<std::size_t>(axis)] : "unknown";
}

}  // namespace

std::string_view to_string(ArmError error) {
  return error < ArmError::count_ ? kTexts[static_cast<std::size_t>(error)].name : "unknown_error";
}

std::string_view explain(ArmError error) {
  return error < ArmError::count_ ? kTexts[static_cast<std::size_t>(error)].sentence
                                  : "An error that is unknown to this program.";
}

std::optional<ArmError> arm_error_from(std::string_view name) {
  for (std::size_t i = 0; i < kArmErrorCount; ++i) {
    if (name == kTexts[i].name) return static_cast<ArmError>(i);
  }
  return std::nullopt;
}

std::vector<std::string> error_list(std::uint64_t errors) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < kArmErrorCount; ++i) {
    if ((errors >> i & 1u) != 0) names.emplace_back(kTexts[i].name);
  }
  return names;
}

std::string error_names(std::uint64_t errors, std::string_view separator) {
  std::string text;
  for (const std::string& name : error_list(errors)) text.append(text.empty() ? "" : separator).append(name);
  return text;
}

std::string describe(const ReflexDetail& detail) {
  if (!detail) return "No error.";
  const Text& text = kTexts[static_cast<std::size_t>(detail.error)];
  std::string where;
  if (detail.index >= 0 && text.about == About::joint) {
    where = "joint " + std::to_string(detail.index + 1) + ": ";
  } else if (detail.index >= 0 && text.about == About::axis) {
    where = std::string(axis_name(detail.index)) + ": ";
  }
  std::array<char, 96> numbers{};
  if (text.unit[0] != '\0') {
    std::snprintf(numbers.data(), numbers.size(), "%.6g, limit %.6g %s", detail.value, detail.limit,
                  text.unit);
  }
  std::string sentence(text.sentence);
  if (where.empty() && numbers[0] == '\0') return sentence;
  return sentence + " (" + where + numbers.data() + ")";
}

}  // namespace multipanda
