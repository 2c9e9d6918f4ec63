#include "ros/adapter/compat/compat.hpp"

#include "ros/adapter/compat/arm_services.hpp"
#include "ros/adapter/compat/goals.hpp"
#include "ros/adapter/compat/mode_services.hpp"
#include "ros/adapter/compat/state_topics.hpp"

namespace multipanda::ros {

AdapterParts make_compat(const AdapterContext& run, const Inputs* inputs) {
  AdapterParts parts;
  const RosOptions& options = *run.options;
  if (options.compat == RosSection::Compat::none) return parts;
  const CompatPackages packages{options.compat, options.compat_arm_messages, options.compat_mode_messages};
  if (options.state) parts.push_back(std::make_unique<CompatState>(run, packages));
  for (ArmIndex arm = 0; options.arms && arm < run.modes->arm_count(); ++arm)
    parts.push_back(std::make_unique<CompatArmServices>(run, packages, arm));
  if (options.compat == RosSection::Compat::multipanda_ros2 && inputs != nullptr) {
    const auto names = std::make_shared<AskedNames>(*run.modes);
    parts.push_back(std::make_unique<CompatModes>(run, packages, names));
    parts.push_back(std::make_unique<CompatGoals>(run, packages, *inputs, names));
  }
  return parts;
}

}  // namespace multipanda::ros
