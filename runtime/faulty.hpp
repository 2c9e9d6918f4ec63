#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// "faulty": holds its arm by damping until `after_s` has passed, then misbehaves on purpose. For the demo and
// for tests only; no scene of one's own should name it, and only the demo's registry knows it.
ControlletType faulty_controllet();

}  // namespace multipanda
