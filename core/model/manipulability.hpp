#pragma once

#include "core/types/joints.hpp"

namespace multipanda {

// The manipulability m = sqrt(det(J J^T)), the volume of the ellipsoid of velocities at E for unit joint
// velocities (Yoshikawa 1985), and its gradient.
struct Manipulability {
  double value = 0;      // m; meters and radians are mixed, as is usual
  JointVector gradient;  // dm/dq (n x 1) [1/rad]
  // (J J^T + eps 1)^-1 J (6 x n). P = 1 - J^T J_dual projects joint velocities onto those that do not move E.
  // It is symmetric with eigenvalues from 0 to 1.
  Jacobian J_dual;

  JointVector self_motion(const Jacobian& J, const JointVector& dq) const;  // P dq (n x 1)
};

// The gradient in closed form, from the kinematic Hessian of a serial arm,
//   dJ_j/dq_k = [w_k x v_j; w_k x w_j] for k <= j, [w_j x v_k; 0] for k > j,   J_j = [v_j; w_j],
//   dm/dq_k = m tr((J J^T + eps 1)^-1 (dJ/dq_k) J^T),
// in O(n) by prefix sums over the joints. At a singular pose m has a kink, as |x| has at 0. eps = 1e-12
// smooths it: the gradient is zero there. Everywhere it is bounded by the product of the five larger
// singular values of J times the norm of dJ/dq. J = J_V_WE of any arm with revolute and prismatic joints.
// Does not allocate.
void compute_manipulability(const Jacobian& J, Manipulability& result);

}  // namespace multipanda
