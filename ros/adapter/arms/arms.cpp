#include "ros/adapter/arms/arms.hpp"

#include "ros/adapter/arms/arm_services.hpp"
#include "ros/adapter/arms/gripper.hpp"
#include "ros/adapter/arms/motion_actions.hpp"

namespace multipanda::ros {

AdapterParts make_arms(const AdapterContext& run) {
  AdapterParts parts;
  for (ArmIndex arm = 0; arm < run.modes->arm_count(); ++arm) {
    if (run.options->motions) parts.push_back(std::make_unique<MotionActions>(run, arm));
    if (!run.options->arms) continue;
    parts.push_back(std::make_unique<ArmServices>(run, arm));
    if (run.backend->capabilities(arm).has_gripper) parts.push_back(std::make_unique<Gripper>(run, arm));
  }
  return parts;
}

}  // namespace multipanda::ros
