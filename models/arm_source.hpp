#pragma once

#include "core/model/arm_model.hpp"
#include "models/robot_description.hpp"

namespace multipanda {

// What the core's ArmModel is built from: the URDF without geometry, the limits, the home configuration, the
// capsules that collide (links and hand) and which of them can collide.
// X_WB places the base in the world. Throws std::invalid_argument if `hand` is set and the robot has no hand,
// or if a hull of the base has more corners than a shape may have.
ArmModelSource arm_model_source(const RobotDescription& robot, const Pose& X_WB, bool hand);

}  // namespace multipanda
