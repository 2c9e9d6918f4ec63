#pragma once

#include "multipanda_semantic_components/arm_interface.hpp"

namespace multipanda_semantic_components {

// All that the hardware knows of an arm: <arm>/robot_state.
class RobotState : public ArmInterface {
 public:
  explicit RobotState(const std::string& arm) : ArmInterface(arm, "robot_state") {}

  // Of the last read(); nothing to see (false) where it is not multipanda's hardware, or it is gone.
  multipanda::ros::ArmView get() const { return view(); }
  // Fills all that the hardware knows; header, arm, names and what a controller commands are the caller's.
  // False: as above.
  bool get_values_as_message(multipanda_msgs::msg::RobotState& message) const {
    const auto arm = view();
    if (arm) arm.state(message);
    return static_cast<bool>(arm);
  }
};

}  // namespace multipanda_semantic_components
