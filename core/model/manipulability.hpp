#pragma once

#include "core/types/joints.hpp"

namespace multipanda {

// m = sqrt(det(J J^T)), the volume of what a unit joint velocity does at E, and what the feature of that name
// needs beside it.
struct Manipulability {
  double value = 0;      // m; metres and radians mixed, as everybody does
  JointVector gradient;  // dm/dq (n x 1) [1/rad]
  // (J J^T + eps 1)^-1 J (6 x n). With it P = 1 - J^T (...) projects joint velocities onto those that do not
  // move E: symmetric, eigenvalues from 0 to 1.
  Jacobian J_dual;

  JointVector self_motion(const Jacobian& J, const JointVector& dq) const;  // P dq (n x 1)
};

// The gradient in closed form, from the kinematic Hessian of a serial arm,
//   dJ_j/dq_k = [w_k x v_j; w_k x w_j] for k <= j, [w_j x v_k; 0] for k > j,   J_j = [v_j; w_j],
//   dm/dq_k = m tr((J J^T + eps 1)^-1 (dJ/dq_k) J^T),
// which prefix sums over the joints give in O(n). At a singular pose m has a kink, as |x| at 0; eps = 1e-12
// rounds it: there the gradient is zero, and it is bounded everywhere, by the product of the five larger
// singular values of J times the size of dJ/dq. J = J_V_WE of any revolute or prismatic arm. Never allocates.
void compute_manipulability(const Jacobian& J, Manipulability& result);

}  // namespace multipanda
