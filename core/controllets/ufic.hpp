#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// Unified force-impedance control of one arm, kept passive by two energy tanks. Law, valves and what is
// booked: docs/controllets/ufic.md.
//   tau  = J^T (s K_c x~ + D_c (s V_d - V) + s Lambda A_d + n D_z (s v_d,n - v_n) + F_f')
//          + N (s K_N (q_N - q) - D_N N^T dq) + C dq,          s = 1 + alpha_i
//   F_f' = share(f) n f + share(F_t) F_t                       energy_tank.hpp: force_share
ControlletType ufic_controllet();

}  // namespace multipanda
