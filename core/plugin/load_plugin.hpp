#pragma once

#include <string>
#include <vector>

#include "core/controllets/controllet.hpp"
#include "core/modes/registry.hpp"
#include "core/plugin/c_law.h"

namespace multipanda {

// Loads a user's library (exports: core/plugin/plugin.hpp, or c_law.h for laws behind the C interface) and
// adds its controllets, features and backends. Throws std::runtime_error with the reason: not found,
// unresolved symbol, built with other headers or other flags, another version of the C interface;
// std::invalid_argument if a name is taken. A loaded library is never unloaded.
void load_plugin(Registry& registry, const std::string& path);

// The laws of a library behind the C interface (c_law.h) as controllets. Throws std::runtime_error with the
// reason: another version, sizes of another compiler, a name or number that no descriptor may have.
std::vector<ControlletType> c_law_controllets(const multipanda_c_laws& laws);

}  // namespace multipanda
