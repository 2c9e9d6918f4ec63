#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// DC: two arms under one ownership, each with its own Cartesian impedance (cartesian_law.hpp). Their
// set-points are one common pose, shifted by +offset for the first arm and -offset for the second, or one
// pose each.
ControlletType dual_cartesian_impedance_controllet();

}  // namespace multipanda
