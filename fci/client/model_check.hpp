#pragma once

#include <string>

#include "core/model/arm_model.hpp"

namespace multipanda::fci {

// How far two models of an arm are from each other, over seeded configurations within the joint limits.
struct ModelComparison {
  double position_m = 0, orientation_rad = 0;  // of the flange
  double gravity_nm = 0;                       // of any joint
  double mass_matrix = 0;                      // largest relative difference, in the Frobenius norm
  double q_min_rad = 0, q_max_rad = 0;         // how far our joint limits lie outside the arm's; 0: within
  std::string limits;                          // the joints concerned, in words

  static constexpr double kKinematics = 1e-4;  // [m], [rad]: beyond it is another arm
  static constexpr double kGravity = 0.05;     // [N m]: less than joint friction hides
  static constexpr double kMass = 0.01;
  bool same_kinematics() const { return position_m <= kKinematics && orientation_rad <= kKinematics; }
  bool same_dynamics() const { return gravity_nm <= kGravity && mass_matrix <= kMass; }
  std::string text() const;  // with figures
};

// The model that the arm handed out (URDF, without hand) against the controllers'. `hand`: what `ours`
// contains behind the flange; it is added to the arm's. Throws std::invalid_argument if the URDF cannot be
// used.
ModelComparison compare_models(const std::string& arm_urdf, const Load& hand, const ArmModel& ours);

}  // namespace multipanda::fci
