#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// The safe default: holds every arm that has no other owner.
//   tau = K (q_0 - q) - D dq + C dq
// q_0 [rad] is the measured position at entry, clamped to the joint limits; K [N m/rad] is diagonal and D
// gives every coupled mode the damping ratio zeta. Closed loop (exact model): M ddq + D dq + K (q - q_0) =
// tau_ext. Soft enough to be pushed by hand; an undeclared load of 1 kg sinks less than 3 cm.
ControlletType hold_controllet();

}  // namespace multipanda
