#pragma once

#include <string>

#include "core/modes/registry.hpp"

namespace multipanda {

// Loads a user's library (core/plugin/plugin.hpp says what it exports) and adds its controllets, features and
// backends. Throws std::runtime_error with the reason: not found, unresolved symbol, built with other headers
// or other flags; std::invalid_argument if a name is taken. Never unloaded.
void load_plugin(Registry& registry, const std::string& path);

}  // namespace multipanda
