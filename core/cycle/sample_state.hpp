#pragma once

#include "core/record/cycle_record.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda {

// Copies what the arm measured and reported. Leaves owner, interventions and the command alone.
void set_state(ArmSample& sample, const ArmState& state);

}  // namespace multipanda
