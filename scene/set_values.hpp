#pragma once

#include <string>
#include <vector>

#include "scene/load.hpp"

namespace multipanda {

// The scene read again with other values, each "KEY=VALUE" as in an Override. Its text contains them, for the
// log; lines in messages are those of that text. Throws ConfigError: no such key, or a value that the scene
// does not accept.
Scene with_values(const OpenedScene& opened, const std::vector<std::string>& settings);

}  // namespace multipanda
