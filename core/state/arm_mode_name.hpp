#pragma once

#include <string_view>

#include "core/state/arm_state.hpp"

namespace multipanda {

// Name of the mode for users and programs, for example "user_stopped". Not for the loop. An invalid value
// gives "unknown".
std::string_view to_string(ArmMode mode);

}  // namespace multipanda
