#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// Every joint a spring and a damper towards its set-point.
//   tau = K (q_d - q) + D (dq_d - dq) + C dq  (+ M ddq_d)
// D by the coupled design from the full M and K (every mode has damping ratio zeta), each joint alone, or
// given.
ControlletType joint_impedance_controllet();

}  // namespace multipanda
