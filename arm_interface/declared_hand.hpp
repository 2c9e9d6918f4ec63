#pragma once

#include "core/state/arm_state.hpp"

namespace multipanda {

// The manufacturer's hand as declared by its arms ("end effector" in their settings, m_ee F_x_Cee I_ee of
// their states): rounded figures, which differ from those of its parts. In the flange frame.
Load manufacturers_hand_as_declared();

// The hand's declared body for a model (in the flange): the figures above for the manufacturer's hand,
// otherwise the model's own.
Load declared_hand(const Load& hand);

}  // namespace multipanda
