#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// Hand guiding: the arm compensates its own gravity only.
//   tau = C dq - D dq
// Closed loop (exact model): M ddq + D dq = tau_ext. The arm itself compensates gravity (CONVENTIONS.md). D
// [N m s/rad] is a small damping, so that a pushed arm comes to rest.
ControlletType gravity_compensation_controllet();

}  // namespace multipanda
