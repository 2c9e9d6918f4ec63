#pragma once

#include <string>
#include <vector>

#include "scene/scene.hpp"

namespace multipanda::ros {

// ROS options of a run: the scene's section `ros:`, overridden by the command line and the host.
struct RosOptions : RosSection {
  std::vector<std::string> arguments;  // for rcl, as after --ros-args: "-r", "joint_states:=arms" ...
  // False on a node with its own parameter services (ros2_control); then only ParameterTable is used.
  bool parameter_services = true;
  // Packages that provide the messages of `compat`.
  std::string compat_arm_messages = "franka_msgs", compat_mode_messages = "multi_mode_control_msgs";
  // Parts to create; a run that shares its node leaves some to others. `arms`: requests to the backend
  // (services, grippers). `motions`: actions executed by the arms' controllets.
  bool controllets = true, arms = true, motions = true, state = true;
};

}  // namespace multipanda::ros
