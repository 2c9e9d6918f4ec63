#pragma once

#include <vector>

#include "core/controllets/controllet.hpp"
#include "core/plugin/c_law.h"

namespace multipanda {

// The laws of a library behind the C interface (c_law.h) as controllets. Throws std::runtime_error with the
// reason: another version, sizes of another compiler, a name or number that no descriptor may have.
std::vector<ControlletType> c_law_controllets(const multipanda_c_laws& laws);

}  // namespace multipanda
