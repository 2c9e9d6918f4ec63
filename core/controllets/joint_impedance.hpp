#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// Joint impedance: each joint is a spring and damper about its set-point.
//   tau = K (q_d - q) + D (dq_d - dq) + C dq  (+ M ddq_d)
// Closed loop (exact model, with M ddq_d): M dde + (C + D) de + K e = -tau_ext, e = q_d - q; at rest an
// external torque deflects by K^-1 tau_ext. K [N m/rad]. D [N m s/rad] is designed from the full M and K
// (every mode has damping ratio zeta), for each joint alone, or given; it acts on de or, if chosen, on -dq.
ControlletType joint_impedance_controllet();

}  // namespace multipanda
