#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// Bilateral teleoperation: the first arm leads, the second follows, and the leader feels what the follower
// meets. Two energy tanks and a channel that only passes energy on keep it passive with any delay and loss
// (two layers: Franken et al., IEEE Transactions on Robotics 2011). Law: docs/controllets/teleoperation.md.
ControlletType teleoperation_controllet();

}  // namespace multipanda
