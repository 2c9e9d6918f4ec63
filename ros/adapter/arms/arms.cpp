#include "ros/adapter/arms/arms.hpp"

#include "ros/adapter/arms/arm_services.hpp"
#include "ros/adapter/arms/gripper.hpp"
#include "ros/adapter/arms/motion_actions.hpp"

namespace multipanda::ros {

Parts make_arms(const AdapterWorld& world) {
  Parts parts;
  for (ArmIndex arm = 0; arm < world.modes->arm_count(); ++arm) {
    if (world.options->motions) parts.push_back(std::make_unique<MotionActions>(world, arm));
    if (!world.options->arms) continue;
    parts.push_back(std::make_unique<ArmServices>(world, arm));
    if (world.backend->capabilities(arm).has_gripper) parts.push_back(std::make_unique<Gripper>(world, arm));
  }
  return parts;
}

}  // namespace multipanda::ros
