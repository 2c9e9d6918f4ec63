#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// Presses with a given force, one arm; holds its pose by an impedance in the other directions. Law, approach
// and loss of contact: docs/controllets/force.md.
//   tau = J^T ((1 - w) P_n F_i + (I - P_n) F_i + n (w gamma f - D_z v_n)) + tau_null + C dq,  P_n = n n^T
ControlletType force_controllet();

}  // namespace multipanda
