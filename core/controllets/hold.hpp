#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// The safe default: holds every arm that has no other owner.
//   tau = K (q_0 - q) - D dq + C dq
// q_0 [rad] is the measured position at entry; from beyond a joint limit it moves back to the limit at 0.1
// rad/s, and waits where the joint does not follow: its spring pushes with at most 10 N m there (1.3 N m at
// the wrist). K [N m/rad] is diagonal and D gives every coupled mode the damping ratio zeta or more: it is
// designed for K, but never for less than the default stiffness. Modes faster than 100 rad/s are softened to
// that, so that the hold is stable behind motors of 50 Hz and a delay of 3 ms in every pose. Closed loop
// (exact model): M ddq + D dq + K (q - q_0) = tau_ext. Soft enough to be pushed by hand; an undeclared load
// of 1 kg sinks less than 3 cm. The q_0 of a prismatic joint follows a carriage that is pushed farther than
// 60 N, or the scene's spring_force, over K: it stays there.
ControlletType hold_controllet();

}  // namespace multipanda
