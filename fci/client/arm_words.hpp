#pragma once

#include <string>
#include <string_view>

#include "fci/wire/robot_state.hpp"

// An arm's state in words.
namespace multipanda::fci {

inline bool is_mode(const RobotState& state, RobotMode mode) {
  return state.robot_mode == static_cast<std::uint8_t>(mode);
}
// "reflex", "user stopped": the arm's mode for people.
std::string_view mode_name(std::uint8_t robot_mode);
// "(joint_reflex, cartesian_reflex) ": the errors active now, or nothing.
std::string error_list(const RobotState& state);
// Why an arm in this mode does not do what was asked, and what to do about it.
std::string refusal_in_mode(const std::string& arm, const RobotState& state);

}  // namespace multipanda::fci
