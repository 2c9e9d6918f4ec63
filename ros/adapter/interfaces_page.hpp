#pragma once

#include <string>
#include <vector>

#include "ros/rcl/node.hpp"
#include "scene/scene.hpp"

namespace multipanda::ros {

// Returns tables of a run's ROS interfaces as Markdown. They list the interfaces of a run of `scene`, with
// the scene's names replaced by placeholders (<arm>, <instance>). `node`: as in Node::full_name().
// `features`: names of all feature types.
std::string interfaces_markdown(const std::vector<EntityInfo>& entities, const std::string& node,
                                const Scene& scene, const std::vector<std::string>& features);

// Returns the page: the handwritten part of `before` up to the marker line, then the tables. Throws
// std::invalid_argument if the marker is missing.
std::string with_tables(const std::string& before, const std::string& tables);

// Builds a run of a scene, without starting it, and returns interfaces_markdown() for it. Uses the ROS domain
// of this process.
std::string scene_interface_tables(const std::string& scene);

}  // namespace multipanda::ros
