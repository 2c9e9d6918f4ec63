#pragma once

#include "multipanda_semantic_components/arm_interface.hpp"

namespace multipanda_semantic_components {

// The hardware's data for an arm: <arm>/multipanda_state.
class RobotState : public ArmInterface {
 public:
  explicit RobotState(const std::string& arm) : ArmInterface(arm, "multipanda_state") {}

  // Data of the last read(). Empty (false) if the hardware is not multipanda's, or has gone.
  multipanda::ros::ArmView get() const { return view(); }
  // Fills everything known to the hardware. The caller sets header, arm, names and commands of a controller.
  // Returns false as above.
  bool get_values_as_message(multipanda_msgs::msg::RobotState& message) const {
    const auto arm = view();
    if (arm) arm.state(message);
    return static_cast<bool>(arm);
  }
};

}  // namespace multipanda_semantic_components
