#pragma once

#include <cstddef>
#include <multipanda_msgs/srv/set_cartesian_stiffness.hpp>
#include <multipanda_msgs/srv/set_collision_behavior.hpp>
#include <multipanda_msgs/srv/set_joint_stiffness.hpp>
#include <multipanda_msgs/srv/set_load.hpp>
#include <multipanda_msgs/srv/set_stiffness_frame.hpp>
#include <multipanda_msgs/srv/set_tool_frame.hpp>

#include "core/cycle/backend.hpp"

// What services ask of an arm of n joints, as the backend takes it. Here only what a message can get wrong
// (sizes, quaternions); what an arm cannot take, the backend refuses itself. All throw std::invalid_argument.
namespace multipanda::ros {

ArmRequest read_request(const multipanda_msgs::srv::SetLoad::Request& request, std::size_t n);
ArmRequest read_request(const multipanda_msgs::srv::SetToolFrame::Request& request, std::size_t n);
ArmRequest read_request(const multipanda_msgs::srv::SetStiffnessFrame::Request& request, std::size_t n);
ArmRequest read_request(const multipanda_msgs::srv::SetCollisionBehavior::Request& request, std::size_t n);
ArmRequest read_request(const multipanda_msgs::srv::SetJointStiffness::Request& request, std::size_t n);
ArmRequest read_request(const multipanda_msgs::srv::SetCartesianStiffness::Request& request, std::size_t n);

// A pose of finite numbers whose quaternion has unit length within 1 %. `what` it is, for the refusal.
Pose read_pose(const geometry_msgs::msg::Pose& pose, const std::string& what);

}  // namespace multipanda::ros
