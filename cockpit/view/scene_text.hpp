#pragma once

#include <nlohmann/json.hpp>

#include "scene/scene.hpp"

namespace multipanda::cockpit {

// The part `arms` of a scene's description (docs/cockpit_wire.md): limits, bases, end effectors, as the scene
// has them.
nlohmann::json describe_arms(const Scene& scene);

}  // namespace multipanda::cockpit
