#pragma once

#include "models/robot_description.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// The robot with its flange at X_LF in the last link. The mass of hand and `tool`, which move along, is taken
// from the last link, so that the whole stays what it was, as nearly as a physical link can.
RobotDescription with_flange(const RobotDescription& robot, const SceneArm& arm, const Pose& X_LF);

}  // namespace multipanda
