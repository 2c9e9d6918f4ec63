#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// Unified force-impedance control of two hands that hold one object: the squeeze is force-controlled and the
// motion of the object an impedance. Both use the cooperative coordinates of
// core/controllets/cooperative_frame.hpp, with the estimates of A at the hands themselves (X_EiA is a
// rotation): each hand then carries half of a force on A without a moment, which a pad could not bear.
//   [F_1; F_2] = L^T ([s K_a x~_a; s K_r x~_r] + D (s [V_a; V_r]_d - [V_a; V_r]) + s [F_ff; 0]
//                     - [0; n] (F_f' + D_z (v_n - s v_d,n)))
//   tau_i = J_i^T F_i + N_i (s K_N (q_N - q) - D_N N_i^T dq) + C_i dq_i,      s = 1 + alpha_i
// n: unit vector from the first hand to the second, turning with the set-point. F_f' acts on the mean squeeze
// f^ = (n^T F^_1 - n^T F^_2) / 2. At rest in a grasp, a force F on the object moves it by K_a^-1 F and f^ =
// F_d. Phases, valves and energy balance: docs/controllets/coupled_ufic.md.
ControlletType coupled_ufic_controllet();

}  // namespace multipanda
