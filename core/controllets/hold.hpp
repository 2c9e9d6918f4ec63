#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// The safe default: every arm that nobody owns is held by it.
//   tau = K (q_0 - q) - D dq + C dq
// q_0 is the measured position at entry, kept within the joint limits; D is designed for damping ratio zeta
// on the diagonal of M. Soft enough to be pushed by hand, stiff enough that 1 kg undeclared sinks less than 3
// cm.
ControlletType hold_controllet();

}  // namespace multipanda
