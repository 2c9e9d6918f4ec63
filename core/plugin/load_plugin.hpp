#pragma once

#include <string>

#include "core/modes/registry.hpp"

namespace multipanda {

// Loads a user's library (core/plugin/plugin.hpp says what it exports, c_law.h what a library of laws behind
// the C interface exports) and adds its controllets, features and backends. Throws std::runtime_error with
// the reason: not found, unresolved symbol, built with other headers or other flags, another version of the C
// interface; std::invalid_argument if a name is taken. A loaded library is never unloaded.
void load_plugin(Registry& registry, const std::string& path);

}  // namespace multipanda
