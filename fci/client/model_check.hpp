#pragma once

#include <string>

#include "core/model/arm_model.hpp"

namespace multipanda::fci {

// Differences of two models of an arm over seeded configurations within the joint limits.
struct ModelComparison {
  double position_m = 0, orientation_rad = 0;  // of the flange
  double gravity_nm = 0;                       // of any joint
  double mass_matrix = 0;                      // largest relative difference, in the Frobenius norm
  double q_min_rad = 0, q_max_rad = 0;  // how far the scene's joint limits are outside the arm's; 0: within
  std::string limits;                   // the affected joints, human-readable

  static constexpr double kKinematics = 1e-4;  // [m], [rad]: above it the arms differ
  static constexpr double kGravity = 0.05;     // [N m]: below joint friction
  static constexpr double kMass = 0.01;
  bool same_kinematics() const { return position_m <= kKinematics && orientation_rad <= kKinematics; }
  bool same_dynamics() const { return gravity_nm <= kGravity && mass_matrix <= kMass; }
  std::string text() const;  // with figures
};

// Compares the model from the arm (URDF, without hand) with the controllers' model. `hand`: the load
// behind the flange in `ours`; it is added to the arm's model. Throws std::invalid_argument if the URDF
// cannot be used.
ModelComparison compare_models(const std::string& arm_urdf, const Load& hand, const ArmModel& ours);

}  // namespace multipanda::fci
