#pragma once

#include <string>

namespace multipanda::ros {

// Builds a run of a scene, without starting it, and returns interfaces_markdown() for it. Uses the ROS domain
// of this process.
std::string scene_interface_tables(const std::string& scene);

}  // namespace multipanda::ros
