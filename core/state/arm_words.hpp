#pragma once

#include <string_view>

#include "core/state/arm_state.hpp"

namespace multipanda {

// "user_stopped": the mode's name wherever people or programs read it. Off the loop. A number that is no mode
// gives "unknown".
std::string_view to_string(ArmMode mode);

}  // namespace multipanda
