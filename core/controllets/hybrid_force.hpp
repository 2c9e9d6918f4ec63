#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// Force control of one arm along any subset of six axes, moments included, with an impedance along the others
// (Raibert and Craig 1981, with compliance in place of position control).
//   tau = J^T ((I - W) P - D_c V + f - W D_W V) + tau_null + C dq
//   P   = K_c (I - W) x~ + D_c (I - W) V_d + Lambda (I - W) A_d
// W projects on the selected axes of the force frame, translations and rotations each by themselves, and
// fades with the selection; f has a force or moment per selected axis (axis_force.hpp). Along a selected axis
// the set-point follows the arm. World axes, linear first; wrenches [N, N m] are those that the arm exerts,
// at E. Without a selected axis it is `cartesian_impedance`. docs/controllets/hybrid_force.md.
ControlletType hybrid_force_controllet();

}  // namespace multipanda
