#pragma once

#include <string>

namespace multipanda::ros {

// interfaces_markdown() of a run of a scene, which does not begin. In this process' ROS domain.
std::string tables_of_scene(const std::string& scene);

}  // namespace multipanda::ros
