#pragma once

#include <map>
#include <string>

#include "models/robot_description.hpp"

namespace multipanda {

// File name -> content of everything in models/generated: each shipped robot as URDF and MJCF, with and
// without hand.
std::map<std::string, std::string> exported_models();

}  // namespace multipanda
