#pragma once

#include <string>

#include "core/modes/registry.hpp"

namespace multipanda {

// docs/scene_reference.md: every key of a scene file and every controllet and feature that it can name,
// written from the code that reads scenes and from the controllets' own descriptors.
std::string scene_reference_markdown(const Registry& registry);
// config/schemas/scene.json: the same for editors, as JSON Schema.
std::string scene_json_schema(const Registry& registry);

}  // namespace multipanda
