#pragma once

#include "fci/client/fci_backend.hpp"
#include "scene/scene.hpp"

namespace multipanda::fci {

// Configuration from the scene for the arm at `address`: model, frames, tool, load.
// Throws std::invalid_argument.
FciArmConfig fci_arm_config(const SceneArm& arm, const std::string& address);

}  // namespace multipanda::fci
