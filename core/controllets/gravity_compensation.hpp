#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// Hand guiding: the arm carries itself and nothing else.
//   tau = C dq - D dq
// Gravity is the arm's own business (CONVENTIONS.md); D is a little damping, so that a pushed arm comes to
// rest.
ControlletType gravity_compensation_controllet();

}  // namespace multipanda
