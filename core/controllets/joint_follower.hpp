#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// One arm follows the joints of another, which it observes and does not own. Law, alignment, clutch and
// parameters: docs/controllets/joint_follower.md.
ControlletType joint_follower_controllet();

}  // namespace multipanda
