#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "core/state/arm_state.hpp"
#include "fci/client/fci_backend.hpp"
#include "fci/wire/robot_state.hpp"

// The arm's state as text.
namespace multipanda::fci {

inline bool is_mode(const RobotState& state, RobotMode mode) {
  return state.robot_mode == static_cast<std::uint8_t>(mode);
}
// "reflex", "user stopped": name of the arm's mode.
std::string_view mode_name(std::uint8_t robot_mode);
// "(joint_reflex, cartesian_reflex) ": the active errors, or an empty string.
std::string error_list(const RobotState& state);
// Why an arm in this mode refuses a request, and the remedy.
std::string refusal_in_mode(const std::string& arm, const RobotState& state);
std::string grams(double mass_kg);  // "1200 g"

// Progress of the program with an arm.
enum class ArmPhase : std::uint8_t {
  offline,
  preparing,  // connected, not yet set up
  stopped,    // set up, no motion
  starting,   // a motion is being started
  running     // the arm has accepted a motion that has not ended
};

// Whether the arm accepts commands of `motion`. A torque motion may run with either generator.
bool takes_commands(const RobotState& state, ArmMotion motion);

// The mode of a connected arm for the loop, from the arm's state and the requests. `motion`: started last;
// `requested`: requested last.
ArmMode mode_of(const RobotState& state, ArmPhase phase, ArmMotion motion, ArmMotion requested);

}  // namespace multipanda::fci
