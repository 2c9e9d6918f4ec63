#pragma once

#include <vector>

#include "backends/mujoco/world.hpp"

namespace multipanda {

// Compiles arms and objects to one MuJoCo model. The caller owns it. Throws std::invalid_argument with
// MuJoCo's reason.
mjModel* compose(const std::vector<WorldArm>& arms, const std::vector<SceneObject>& objects,
                 const WorldPhysics& physics);

}  // namespace multipanda
