#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// Unified force-impedance control (UFIC) of one arm with two energy tanks, after Schindlbeck and Haddadin
// (ICRA 2015) and Haddadin and Shahriari (IJRR 2024). Valves and energy balance: docs/controllets/ufic.md.
//   tau  = J^T (s K_c x~ + D_c (s V_d - V) + s Lambda A_d + n D_z (s v_d,n - v_n) + F_f')
//          + N (s K_N (q_N - q) - D_N N^T dq) + C dq,          s = 1 + alpha_i
//   F_f' = rho(f) n f + rho(F_t) F_t,   rho: force_share() in energy_tank.hpp. World axes; forces [N] are
//   those that the arm exerts. Passive: kinetic energy + springs + tanks never grow by more than the work of
//   the contacts.
ControlletType ufic_controllet();

}  // namespace multipanda
