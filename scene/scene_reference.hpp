#pragma once

#include <string>

#include "core/modes/registry.hpp"

namespace multipanda {

// docs/scene_reference.md: every key of a scene file and every controllet and feature that it can name,
// written from the tables that the reader uses and from the controllets' own statements.
std::string scene_reference_markdown(const Registry& registry);

}  // namespace multipanda
