#pragma once

#include <string>

#include "core/cycle/backend.hpp"

namespace multipanda {

// Why no gripper can carry a request out, or nothing. Off the loop. What a gripper's own limits say is its
// business.
std::string check(const GripperMove& request);
std::string check(const GripperGrasp& request);

}  // namespace multipanda
