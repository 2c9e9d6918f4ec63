#pragma once

#include <vector>

#include "backends/mujoco/world.hpp"

namespace multipanda {

// Compiles arms and objects to one MuJoCo model. The caller owns it. Throws std::invalid_argument with
// MuJoCo's reason.
mjModel* compose(const std::vector<WorldArm>& arms, const std::vector<SceneObject>& objects,
                 const WorldPhysics& physics);

// Contact of fingers with free objects, firm enough to hold them; what fingers do not hold is as before.
void add_finger_pairs(mjSpec* spec, const std::vector<WorldArm>& arms,
                      const std::vector<SceneObject>& objects);

// One weld per arm with a suction cup and object that it can hold; none holds at the start.
void add_cup_welds(mjSpec* spec, const std::vector<WorldArm>& arms, const std::vector<SceneObject>& objects);

}  // namespace multipanda
