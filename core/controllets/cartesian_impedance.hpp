#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// Cartesian impedance of one arm: the end effector is a spring and damper about its set-point, with a soft
// posture in the null space.
//   tau = J^T (K_c x~ + D_c (V_d - J dq) + Lambda A_d) + N (K_N (q_N - q) - D_N N^T dq) + C dq
// Closed loop (exact model, regular pose, dynamic projector): Lambda ddx~ + D_c dx~ + K_c x~ = -F_ext up to
// Lambda dJ dq, so a force F_ext at rest deflects E by K_c^-1 F_ext. World axes, linear first; K_c [N/m, N
// m/rad], D_c [N s/m, N m s/rad]. Details: core/controllets/cartesian_law.hpp,
// docs/controllets/cartesian_impedance.md.
ControlletType cartesian_impedance_controllet();

}  // namespace multipanda
