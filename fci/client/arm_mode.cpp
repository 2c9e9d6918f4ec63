#include "fci/client/arm_mode.hpp"

#include "fci/client/arm_state_text.hpp"

namespace multipanda::fci {
namespace {

struct WireMotion {
  ControllerMode controller{};
  MotionGeneratorMode generator{};
};

// The modes that the arm's states show during a motion.
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
