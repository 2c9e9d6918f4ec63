#pragma once

#include <string>

#include "ros/adapter/adapter_part.hpp"

namespace multipanda::ros {

// The system whose names and types a run offers besides its own, and the packages of its messages.
struct CompatPackages {
  RosSection::Compat with = RosSection::Compat::none;
  std::string arms = "franka_msgs", modes = "multi_mode_control_msgs";
};

// "left", or "left_and_right", as in the names of topics.
inline std::string resource_name(const MultimodeController& modes, const std::vector<ArmIndex>& arms,
                                 const char* between) {
  std::string name;
  for (const ArmIndex arm : arms) name += (name.empty() ? "" : between) + modes.arm_name(arm);
  return name;
}

}  // namespace multipanda::ros
