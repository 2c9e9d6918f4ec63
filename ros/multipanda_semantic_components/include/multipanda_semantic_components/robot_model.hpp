#pragma once

#include "multipanda_semantic_components/arm_interface.hpp"

namespace multipanda_semantic_components {

// The arm's rigid-body model at its measured state, including tool and load: <arm>/multipanda_model. Computed
// on demand.
class RobotModel : public ArmInterface {
 public:
  explicit RobotModel(const std::string& arm) : ArmInterface(arm, "multipanda_model") {}

  // Mass matrix, Coriolis and gravity torques, Jacobian, pose. Empty (false) as in RobotState::get().
  multipanda::ros::ArmView get() const { return view(); }
  bool get_values_as_message(multipanda_msgs::msg::RobotModel& message) const {
    const auto arm = view();
    if (arm) arm.model(message);
    return static_cast<bool>(arm);
  }
};

}  // namespace multipanda_semantic_components
