#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// DC: two arms owned by one controllet, each with its own Cartesian impedance; law and closed loop as in
// cartesian_impedance.hpp. The set-points are one common pose, shifted by +offset for the first arm and
// -offset for the second, or one pose each (world axes).
ControlletType dual_cartesian_impedance_controllet();

}  // namespace multipanda
