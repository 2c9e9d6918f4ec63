#pragma once

#include "fci/server/state_packet.hpp"
#include "scene/scene.hpp"

namespace multipanda::fci {

// What a scene's arm declares of itself: its mounting, and hand and tool as a real arm's settings name them.
// Throws std::invalid_argument.
FixedConfig fixed_config(const SceneArm& arm);

}  // namespace multipanda::fci
