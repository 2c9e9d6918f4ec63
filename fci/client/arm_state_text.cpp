#include "fci/client/arm_state_text.hpp"

#include <cmath>

#include "fci/wire/error_flags.hpp"

namespace multipanda::fci {

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

}  // namespace multipanda::fci
