#pragma once

#include <memory>
#include <string>
#include <vector>

#include "motion_generators/set_point_channel.hpp"

namespace multipanda {

// The run on ROS 2 and the name of this node.
struct TopicArguments {
  std::string node = "/multipanda";  // node of the run, with its namespace
  std::string own_node = "multipanda_generator";
  std::vector<std::string> remaps;  // "a:=b"
};

// Sends set-points to a run's inputs by topics (`multipanda run SCENE --ros`). Its own node publishes
// <node>/<controllet>/<input> and, in rest(), .../goal. Loads the ROS module of this build. Throws
// std::runtime_error if there is no module, or if no such run answers within 15 s.
std::unique_ptr<SetPointChannel> make_topic_link(const TopicArguments& arguments);

}  // namespace multipanda
