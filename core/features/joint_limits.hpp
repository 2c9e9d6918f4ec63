#pragma once

#include "core/features/feature.hpp"

namespace multipanda {

// Repulsion from the joint limits. With d the distance of joint i to the nearer limit and r the range:
//   V_i = 1/2 k (r - d)^2 for d < r, otherwise 0;   tau_i = -dV_i/dq_i - D (r - d)/r dq_i while moving
//   outwards.
// The spring is continuous at the edge of the range, and the damping grows from zero there.
FeatureType joint_limits_feature();

}  // namespace multipanda
