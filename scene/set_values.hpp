#pragma once

#include <string>
#include <vector>

#include "scene/load.hpp"

namespace multipanda {

// The scene read again with other values, each "KEY=VALUE" as in an Override. Its text has them, so that a
// log says what ran; lines in messages are those of that text. Throws ConfigError: no such place, or a value
// that the scene does not accept.
Scene with_values(const OpenedScene& opened, const std::vector<std::string>& settings);

}  // namespace multipanda
