#pragma once

#include <string>
#include <vector>

#include "ros/rcl/node.hpp"
#include "scene/scene.hpp"

namespace multipanda::ros {

// Tables of what a run offers in ROS, as Markdown: made from the entities of a node that shows a run of
// `scene`, with the scene's names put back to what they stand for (<arm>, <instance>). `node` as in
// Node::full_name().
// `features`: names of all types of features.
std::string interfaces_markdown(const std::vector<EntityInfo>& entities, const std::string& node,
                                const Scene& scene, const std::vector<std::string>& features);

// The page: what stands by hand in `before` up to the mark, then the tables. Throws std::invalid_argument: no
// mark.
std::string with_tables(const std::string& before, const std::string& tables);

}  // namespace multipanda::ros
