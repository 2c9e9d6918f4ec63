#pragma once

#include <vector>

#include "backends/mujoco/world.hpp"

namespace multipanda {

inline Eigen::Map<const Vector3> vector_at(const mjtNum* values) { return Eigen::Map<const Vector3>(values); }
// MuJoCo's matrices are row-major.
inline Matrix3 matrix_at(const mjtNum* values) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(values);
}

// Compiles arms and objects to one MuJoCo model, owned by the caller. Throws std::invalid_argument with
// MuJoCo's reason.
mjModel* compose(const std::vector<WorldArm>& arms, const std::vector<SceneObject>& objects,
                 const WorldPhysics& physics);

// Stiffer contacts between fingers and free objects, so that fingers can hold them.
void add_finger_pairs(mjSpec* spec, const std::vector<WorldArm>& arms,
                      const std::vector<SceneObject>& objects);

// One weld for each pair of a suction cup and a free object; none is active at the start.
void add_cup_welds(mjSpec* spec, const std::vector<WorldArm>& arms, const std::vector<SceneObject>& objects);

}  // namespace multipanda
