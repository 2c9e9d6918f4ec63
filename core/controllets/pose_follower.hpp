#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// One arm follows the hand of another, which it observes and does not own. Law, alignment, clutch and
// parameters: docs/controllets/pose_follower.md.
ControlletType pose_follower_controllet();

}  // namespace multipanda
