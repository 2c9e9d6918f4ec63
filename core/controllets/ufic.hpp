#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// Unified force-impedance control of one arm, kept passive by two energy tanks. Law, valves and what is
// booked: docs/controllets/ufic.md.
//   tau  = J^T (s K_c x~ + D_c (s V_d - V) + s Lambda A_d + F_f' - n D_z (v_n - s v_d,n))
//          + N (s K_N (q_N - q) - D_N N^T dq) + C dq,          s = 1 + alpha_i
//   F_f' = share(gamma, alpha_f) (n f + F_t)
ControlletType ufic_controllet();

}  // namespace multipanda
