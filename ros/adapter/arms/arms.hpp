#pragma once

#include "ros/adapter/part.hpp"

namespace multipanda::ros {

// What ROS offers of each arm: services, gripper, motions.
Parts make_arms(const AdapterWorld& world);

}  // namespace multipanda::ros
