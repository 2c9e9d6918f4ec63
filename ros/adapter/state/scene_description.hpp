#pragma once

#include <string>

#include "scene/scene.hpp"

namespace multipanda::ros {

// Returns a URDF of all arms of a scene on the link `world`, with visual shapes. Names of links and joints
// begin with the arm's name. Includes the flange `<arm>_link8` (for seven joints) and hands with sliding
// fingers, but no objects.
std::string scene_urdf(const Scene& scene);

}  // namespace multipanda::ros
