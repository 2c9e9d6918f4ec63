#pragma once

#include <memory>
#include <string>
#include <vector>

#include "generators/set_point_link.hpp"

namespace multipanda {

// Which run on ROS 2, and how this node is called there.
struct TopicWords {
  std::string node = "/multipanda";  // of the run, with its namespace
  std::string own_node = "multipanda_generator";
  std::vector<std::string> remaps;  // "a:=b"
};

// To a run's inputs by its topics (`multipanda run SCENE --ros`): a node of its own, which publishes
// <node>/<controllet>/<input> and, in rest(), .../goal. Loads the ROS module of this build. Throws
// std::runtime_error where there is none, or no such run answers within 15 s.
std::unique_ptr<SetPointLink> make_topic_link(const TopicWords& words);

}  // namespace multipanda
