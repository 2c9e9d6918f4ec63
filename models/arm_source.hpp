#pragma once

#include "core/model/arm_model.hpp"
#include "models/robot_description.hpp"

namespace multipanda {

// Source of the core's ArmModel: URDF without geometry, limits, home configuration, collision capsules (links
// and hand) and the pairs to check. X_WB places the base in the world. Throws std::invalid_argument if `hand`
// is set and the robot has no hand, or if a hull of the base has too many corners for a shape.
ArmModelSource arm_model_source(const RobotDescription& robot, const Pose& X_WB, bool hand);

}  // namespace multipanda
