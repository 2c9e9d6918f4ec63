#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// "faulty": holds its arm by damping until `after_s` has passed, then causes a fault on purpose. For the demo
// and tests; only the demo's registry contains it.
ControlletType faulty_controllet();

}  // namespace multipanda
