#pragma once

#include "core/record/cycle_record.hpp"
#include "core/state/arm_state.hpp"

// Frames, tool and load of an arm as the event arm_config.
namespace multipanda {

// Loop thread.
void put_arm_config(Event& event, const ArmFrames& frames, const Load& tool, const Load& load);
// Returns false and changes nothing for any other event.
bool read_arm_config(const Event& event, ArmFrames& frames, Load& tool, Load& load);

}  // namespace multipanda
