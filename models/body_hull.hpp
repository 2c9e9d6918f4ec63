#pragma once

#include <vector>

#include "core/types/spatial.hpp"

// Convex polytopes around large bodies, such as the torso that carries an arm: capsules would be far too wide
// for them.
namespace multipanda {

struct FittedHull {
  std::vector<Vector3> corners;  // at most 32, as many as a ConvexShape has [m]
  double excess = 0;  // largest distance of its surface from the points' convex hull [m], over 642 directions
};

// A small polytope that contains all points. At most 18 planes that touch them cut it out, so it has at most
// 2 x 18 - 4 corners (Euler). Each plane is added where the polytope reaches farthest beyond the points,
// until that is less than kTightHull. At least 1 mm thick. Throws std::invalid_argument without points.
inline constexpr double kTightHull = 0.01;  // [m]
FittedHull fit_hull(const std::vector<Vector3>& points);

// The same for several shapes; those whose common one is least wider than the larger of them
// share it, until `most` are left. Each becomes
// convex: what is between the ends of a bent body counts as part of it.
std::vector<FittedHull> fit_hulls(std::vector<std::vector<Vector3>> shapes, std::size_t most);

// Whether the hull of these corners overlaps a capsule; where they just touch, within about a millimeter.
bool hull_overlaps(const std::vector<Vector3>& corners, const Vector3& from, const Vector3& to,
                   double radius);

}  // namespace multipanda
