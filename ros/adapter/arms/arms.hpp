#pragma once

#include "ros/adapter/adapter_part.hpp"

namespace multipanda::ros {

// Makes the parts for each arm: services, gripper, motions.
AdapterParts make_arms(const AdapterContext& run);

}  // namespace multipanda::ros
