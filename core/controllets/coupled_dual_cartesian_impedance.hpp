#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// CDC: two hands move one shared frame A and keep their relation to each other, as two impedances in the
// cooperative coordinates of core/controllets/cooperative_frame.hpp:
//   [F_1; F_2] = L^T [F_a; F_r],   tau_i = J_i^T F_i + tau_null,i + C_i dq_i
//   F_a = K_a x~_a + D_a (V_a,d - V_a) + Lambda_a A_a,d,   F_r = K_r x~_r + D_r (V_r,d - V_r)
// A begins midway between the hands with the world's axes; the offsets X_EiA are captured there.
ControlletType coupled_dual_cartesian_impedance_controllet();

}  // namespace multipanda
