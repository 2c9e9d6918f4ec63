#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// Force control of one arm along one direction, with an impedance in all others. Approach and loss of
// contact: docs/controllets/force.md.
//   tau = J^T (F_i - w n n^T F_s + n (w gamma f - D_z v_n) + g_t w F_t) + tau_null + C dq
// F_i the impedance, F_s its spring, n the pressing direction, w from 0 to 1 with the first contact. At rest
// in contact the arm exerts f = F_d along n, by the integral part. World axes; forces [N] are those that the
// arm exerts.
ControlletType force_controllet();

}  // namespace multipanda
