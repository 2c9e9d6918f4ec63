#pragma once

#include <string>

#include "scene/scene.hpp"

namespace multipanda::ros {

// URDF of all arms of a scene on the link `world`, with shapes to see: links and joints with the arm's name
// in front, the flange `<arm>_link8` (of seven joints), hands with sliding fingers. Objects are no part of
// it.
std::string scene_urdf(const Scene& scene);

}  // namespace multipanda::ros
