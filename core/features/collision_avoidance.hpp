#pragma once

#include "core/features/feature.hpp"

namespace multipanda {

// Repulsion between what could collide: the feature's own arms with each other, with themselves, with the
// arms of other owners and with the scene's fixed obstacles. For a pair at distance d below the range r, with
// n the unit vector from B's to A's closest point and v_n the rate at which the gap closes:
//   V = 1/2 k (r - d)^2,   F = k (r - d) + D (r - d)/r max(v_n, 0),   tau_A += J_A^T n F,   tau_B -= J_B^T n
//   F
// J the Jacobians of the closest points. An arm of another owner is only looked at; its own feature pushes
// it.
FeatureType collision_avoidance_feature();

}  // namespace multipanda
