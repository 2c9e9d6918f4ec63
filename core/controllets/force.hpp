#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// Presses with a given force, one arm; holds its pose by an impedance in the other directions. Law, approach
// and loss of contact: docs/controllets/force.md.
//   tau = J^T (F_i - w n n^T F_s + n (w gamma f - D_z v_n) + g_t w F_t) + tau_null + C dq
// F_i the impedance, F_s its spring, n the direction of pressing, w from 0 to 1 with the first contact.
ControlletType force_controllet();

}  // namespace multipanda
