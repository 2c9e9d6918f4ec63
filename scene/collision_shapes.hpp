#pragma once

#include <vector>

#include "core/geometry/obstacle.hpp"
#include "core/model/arm_model.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// A shape of a scene for the distances of the core. The z axis of a plane points out of the ground.
ConvexShape convex_shape(ShapeType shape, const Vector3& size);

// Adds the tool's shapes as parts of the arm behind its last joint. They are never checked against the hand,
// the last link and the link before it. X_JF: the flange in the last joint's frame.
void add_tool_shapes(const std::vector<ToolShape>& tool, const Pose& X_JF, ArmModelSource& source);

// The fixed objects of the scene, and which of them its timeline places elsewhere. Free objects are meant to
// be touched.
std::vector<Obstacle> fixed_obstacles(const Scene& scene);

}  // namespace multipanda
