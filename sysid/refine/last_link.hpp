#pragma once

#include "models/robot_description.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// The robot with its flange at X_LF in the last link. Hand and `tool` move along; their mass is taken from
// the last link, so that their sum stays the same, as closely as a physical link allows.
RobotDescription with_flange(const RobotDescription& robot, const SceneArm& arm, const Pose& X_LF);

}  // namespace multipanda
