#pragma once

#include <string>
#include <string_view>

#include "fci/wire/robot_state.hpp"

// The arm's state as text.
namespace multipanda::fci {

inline bool is_mode(const RobotState& state, RobotMode mode) {
  return state.robot_mode == static_cast<std::uint8_t>(mode);
}
// "reflex", "user stopped": the arm's mode, human-readable.
std::string_view mode_name(std::uint8_t robot_mode);
// "(joint_reflex, cartesian_reflex) ": the active errors, or an empty string.
std::string error_list(const RobotState& state);
// Why an arm in this mode refuses a request, and the remedy.
std::string refusal_in_mode(const std::string& arm, const RobotState& state);
std::string grams(double mass_kg);  // "1200 g"

}  // namespace multipanda::fci
