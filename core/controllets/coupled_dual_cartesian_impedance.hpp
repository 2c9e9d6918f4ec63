#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// CDC: two hands move one shared frame A and keep their relation to each other, as two impedances in the
// cooperative coordinates of core/controllets/cooperative_frame.hpp:
//   [F_1; F_2] = L^T [F_a; F_r],   tau_i = J_i^T F_i + tau_null,i + C_i dq_i
//   [F_a; F_r] = [K_a x~_a; K_r x~_r] + D ([V_a; V_r]_d - [V_a; V_r]) + Lambda [A_a,d; 0]
// with D (12 x 12) designed for the coupled inertia Lambda = L^-T diag(Lambda_1, Lambda_2) L^-1.
// A begins midway between the hands with the world's axes; the offsets X_EiA are captured there.
ControlletType coupled_dual_cartesian_impedance_controllet();

}  // namespace multipanda
