#pragma once

#include "core/features/feature.hpp"

namespace multipanda {

// Compensates the known joint friction (ArmModel::known_friction):
//   tau = k s(dq) tau_f(dq),   s = dq^2 / (dq^2 + v_0^2),   0 <= k <= 1,
// with tau_f the known table [N m]. Smooth, with zero value and slope at rest: it does not chatter or amplify
// velocity noise about zero. It never exceeds the known friction and is in phase with it, so that both
// together dissipate power unless the table exceeds the true friction. Refuses to start if the friction of an
// arm is unknown, or if its backend leaves none to compensate.
FeatureType friction_compensation_feature();

}  // namespace multipanda
