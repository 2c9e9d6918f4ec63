#pragma once

#include <cstdint>

#include "core/state/arm_state.hpp"
#include "fci/client/fci_backend.hpp"

namespace multipanda::fci {

// What the program has done with an arm.
enum class ArmPhase : std::uint8_t {
  offline,
  preparing,  // connected, not yet set up
  stopped,    // set up, no motion
  starting,   // a motion is being started
  running     // the arm has accepted a motion, and its end was not reported
};

// Whether the arm takes commands of `motion`. A torque motion may run with either generator.
bool takes_commands(const RobotState& state, ArmMotion motion);

// The mode of a connected arm for the loop: what the arm's state says, and what was asked of it. `motion`:
// the one started last; `requested`: the one asked for last.
ArmMode mode_of(const RobotState& state, ArmPhase phase, ArmMotion motion, ArmMotion requested);

}  // namespace multipanda::fci
