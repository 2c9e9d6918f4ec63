#pragma once

#include <nlohmann/json.hpp>

#include "scene/scene.hpp"

namespace multipanda::cockpit {

// The part `arms` of a scene's description (cockpit/WIRE.md): limits, bases and end effectors.
nlohmann::json describe_arms(const Scene& scene);

}  // namespace multipanda::cockpit
