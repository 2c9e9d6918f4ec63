#pragma once

#include <string_view>

#include "core/state/arm_state.hpp"

namespace multipanda {

// As programs and people read it: "user_stopped".
std::string_view name_of(ArmMode mode);

}  // namespace multipanda
