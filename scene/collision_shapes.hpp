#pragma once

#include <vector>

#include "core/geometry/obstacle.hpp"
#include "core/model/arm_model.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// A scene's shape as the core's distances know it. A plane's own frame has z upwards, out of the ground.
ConvexShape convex_shape(ShapeType shape, const Vector3& size);

// The tool's shapes as parts of the arm, behind its last joint. They are never checked against what they are
// mounted on: the hand, the last link and the one before it. X_JF: the flange in the last joint's frame.
void add_tool_shapes(const std::vector<ToolShape>& tool, const Pose& X_JF, ArmModelSource& source);

// What stands fixed in the scene. Things that move freely are meant to be touched.
std::vector<Obstacle> fixed_obstacles(const std::vector<SceneObject>& objects);

}  // namespace multipanda
