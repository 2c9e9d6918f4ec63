#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// CDC: two hands move one shared frame A and keep their relative pose, as two impedances in the cooperative
// coordinates of core/controllets/cooperative_frame.hpp:
//   [F_1; F_2] = L^T [F_a; F_r],   tau_i = J_i^T F_i + tau_null,i + C_i dq_i
//   [F_a; F_r] = [K_a x~_a; K_r x~_r] + D ([V_a; V_r]_d - [V_a; V_r]) + Lambda [A_a,d; 0]
// with D (12 x 12) designed for the coupled inertia Lambda = L^-T diag(Lambda_1, Lambda_2) L^-1.
// Closed loop at rest: a wrench F on A moves it by K_a^-1 F, a squeeze F_r changes the relative pose by
// K_r^-1 F_r. World axes, linear first; K [N/m, N m/rad]. A begins midway between the hands, with the axes of
// the world; the offsets X_EiA are captured there.
ControlletType coupled_dual_cartesian_impedance_controllet();

}  // namespace multipanda
