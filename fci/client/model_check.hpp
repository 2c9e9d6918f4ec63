#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/model/arm_model.hpp"

namespace multipanda::fci {

// Differences of two models of an arm over seeded configurations within the joint limits.
struct ModelComparison {
  double position_m = 0, orientation_rad = 0;  // of the flange
  double gravity_nm = 0;                       // of any joint
  double mass_matrix = 0;                      // largest relative difference, in the Frobenius norm
  double q_min_rad = 0, q_max_rad = 0;  // distance of the scene's joint limits beyond the arm's; 0: within
  std::string limits;                   // names of the affected joints

  // Largest differences of the same arm. A Panda's library and its published identification, which predict
  // measured torques equally well, differ by 0.19 N m and 6 %.
  double gravity_limit_nm = 0.05;  // below joint friction
  double mass_limit = 0.01;

  static constexpr double kKinematics = 1e-4;  // [m], [rad]: above it the arms differ
  bool same_kinematics() const { return position_m <= kKinematics && orientation_rad <= kKinematics; }
  bool same_dynamics() const { return gravity_nm <= gravity_limit_nm && mass_matrix <= mass_limit; }
  std::string text() const;  // with figures
};

// Compares the model from the arm (URDF, without hand) with the controllers' model. `hand`: the load
// behind the flange in `ours`; it is added to the arm's model. Throws std::invalid_argument if the URDF
// cannot be used.
ModelComparison compare_models(const std::string& arm_urdf, const Load& hand, const ArmModel& ours);
// The same with the shared library of an arm up to protocol version 9: loaded into this process, as libfranka
// does; without joint limits. Throws std::invalid_argument also if it is made for another processor.
ModelComparison compare_models(const std::vector<std::byte>& arm_library, const Load& hand,
                               const ArmModel& ours);

}  // namespace multipanda::fci
