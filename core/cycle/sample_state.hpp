#pragma once

#include "core/record/cycle_record.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda {

// Copies the arm's measurements and reports. Leaves owner, interventions and the command unchanged.
void set_state(ArmSample& sample, const ArmState& state);

}  // namespace multipanda
