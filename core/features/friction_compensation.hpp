#pragma once

#include "core/features/feature.hpp"

namespace multipanda {

// Adds what the joints' friction takes, as far as the controllers know it (ArmModel::known_friction):
//   tau = k s(dq) tau_f(dq),   s = dq^2 / (dq^2 + v_0^2),   0 <= k <= 1,
// tau_f the known table. Smooth, zero at rest with zero slope there: no chatter, and velocity noise about
// zero is not amplified. Never more than the known friction and in phase with it, so that the two together
// take power, if the table is not larger than the true friction.
//
// Does not start where an arm's friction is not known, or where its backend leaves none to compensate.
FeatureType friction_compensation_feature();

}  // namespace multipanda
