#pragma once

#include "core/features/feature.hpp"

namespace multipanda {

// Repulsion between bodies that could collide: the feature's own arms with each other, with themselves, with
// the arms of other owners and with the fixed obstacles of the scene. For a pair at distance d below the
// range r, x = 1 - d/r, n the unit vector from B's to A's closest point and v_n the rate at which the gap
// closes:
//   V = k r^2 (-x - ln(1 - x)),   F = -dV/dd + D x max(v_n, 0) = k r x/(1 - x) + D x max(v_n, 0),
//   tau_A += J_A^T n F,   tau_B -= J_B^T n F,   J the Jacobians of the closest points.
// The stiffness is k at the edge of the range and increases towards contact; beyond x = 0.8 the force follows
// its tangent, so that it stays bounded. Arms of other owners are not pushed: their own feature does that.
FeatureType collision_avoidance_feature();

}  // namespace multipanda
