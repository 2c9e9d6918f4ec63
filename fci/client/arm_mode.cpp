#include "fci/client/arm_mode.hpp"

#include <cmath>

#include "fci/wire/error_flags.hpp"

namespace multipanda::fci {
namespace {

struct WireMotion {
  ControllerMode controller{};
  MotionGeneratorMode generator{};
};

// Modes in the arm's states during a motion.
WireMotion shown_as(ArmMotion motion) {
  switch (motion) {
    case ArmMotion::joint_position:
      return {ControllerMode::joint_impedance, MotionGeneratorMode::joint_position};
    case ArmMotion::joint_velocity:
      return {ControllerMode::joint_impedance, MotionGeneratorMode::joint_velocity};
    case ArmMotion::cartesian_pose:
      return {ControllerMode::cartesian_impedance, MotionGeneratorMode::cartesian_position};
    case ArmMotion::cartesian_velocity:
      return {ControllerMode::cartesian_impedance, MotionGeneratorMode::cartesian_velocity};
    case ArmMotion::torque:
    case ArmMotion::none:
      break;
  }
  return {ControllerMode::external, MotionGeneratorMode::none};
}

}  // namespace

std::string_view mode_name(std::uint8_t robot_mode) {
  switch (static_cast<RobotMode>(robot_mode)) {
    case RobotMode::other:
      return "other";
    case RobotMode::idle:
      return "idle";
    case RobotMode::move:
      return "move";
    case RobotMode::guiding:
      return "guiding";
    case RobotMode::reflex:
      return "reflex";
    case RobotMode::user_stopped:
      return "user stopped";
    case RobotMode::automatic_error_recovery:
      return "recovering";
  }
  return "unknown";
}

std::string error_list(const RobotState& state) {
  std::string list;
  for (std::size_t i = 0; i < kErrorCount; ++i) {
    if (state.errors[i] == 0) continue;
    list += (list.empty() ? "" : ", ") + std::string(kErrorNames[i]);
  }
  return list.empty() ? list : "(" + list + ") ";
}

std::string refusal_in_mode(const std::string& arm, const RobotState& state) {
  const std::string text = "not possible in mode " + std::string(mode_name(state.robot_mode)) + ": ";
  switch (static_cast<RobotMode>(state.robot_mode)) {
    case RobotMode::move:
      return text + "stop the motion first";
    case RobotMode::guiding:
      return text + "release the guiding buttons";
    case RobotMode::reflex:
      return text + error_list(state) + "run `multipanda ctl recover " + arm + "`";
    case RobotMode::user_stopped:
      return text + "release the stop button, then run `multipanda ctl recover " + arm + "`";
    case RobotMode::automatic_error_recovery:
      return text + "wait until it is done";
    case RobotMode::other:
      return text +
             "check in the arm's web interface that the joints are unlocked (brakes open) and the FCI is "
             "activated";
    case RobotMode::idle:
      break;
  }
  return text + "check the arm's web interface";
}

std::string grams(double mass_kg) { return std::to_string(std::lround(mass_kg * 1000)) + " g"; }

bool takes_commands(const RobotState& state, ArmMotion motion) {
  const auto generator = static_cast<MotionGeneratorMode>(state.motion_generator_mode);
  const WireMotion ours = shown_as(motion);
  const bool torque = motion == ArmMotion::torque;
  return motion != ArmMotion::none && is_mode(state, RobotMode::move) &&
         state.controller_mode == static_cast<std::uint8_t>(ours.controller) &&
         (generator == ours.generator || (torque && generator == MotionGeneratorMode::joint_velocity));
}

ArmMode mode_of(const RobotState& state, ArmPhase phase, ArmMotion motion, ArmMotion requested) {
  switch (static_cast<RobotMode>(state.robot_mode)) {
    case RobotMode::move:
      return phase >= ArmPhase::starting && takes_commands(state, motion) ? ArmMode::move : ArmMode::other;
    case RobotMode::idle:
      if (requested == ArmMotion::none) return ArmMode::idle;
      if (requested != motion) return ArmMode::recovering;
      return phase == ArmPhase::starting || phase == ArmPhase::preparing ? ArmMode::recovering
                                                                         : ArmMode::other;
    case RobotMode::guiding:
      return ArmMode::guiding;
    case RobotMode::reflex:
      return ArmMode::reflex;
    case RobotMode::user_stopped:
      return ArmMode::user_stopped;
    case RobotMode::automatic_error_recovery:
      return ArmMode::recovering;
    case RobotMode::other:
      break;
  }
  return ArmMode::other;
}

}  // namespace multipanda::fci
