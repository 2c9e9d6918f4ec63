#pragma once

#include <string>
#include <vector>

#include "scene/ros_section.hpp"

namespace multipanda::ros {

// How a run speaks ROS: the scene's section `ros:`, then what the command line and the host say.
struct RosOptions : RosSection {
  std::vector<std::string> arguments;  // for rcl, as after --ros-args: "-r", "joint_states:=arms" ...
  // False on a node that has parameters of its own (ros2_control): then only ParameterTable is used.
  bool parameter_services = true;
  // Which parts there are: whoever shares its node with another one leaves to that what it offers.
  // `arms`: what the backend is asked (services, grippers); `motions`: what the arms' controllets are asked.
  bool controllets = true, arms = true, motions = true, state = true;
};

}  // namespace multipanda::ros
