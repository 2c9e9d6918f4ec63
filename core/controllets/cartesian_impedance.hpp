#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// The end effector a spring and a damper towards its set-point, the elbow a soft spring of its own.
//   tau = J^T (K_c x~ + D_c (V_d - J dq) + Lambda A_d) + N (K_N (q_N - q) - D_N N^T dq) + C dq
// Law and choices: core/controllets/cartesian_law.hpp, docs/controllets/cartesian_impedance.md.
ControlletType cartesian_impedance_controllet();

}  // namespace multipanda
