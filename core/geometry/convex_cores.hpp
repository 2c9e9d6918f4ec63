#pragma once

#include "core/geometry/distance.hpp"

namespace multipanda {

// Closest points of two convex cores (radius left out, no half spaces), everything in A's frame; X_AB places
// B. Gilbert, Johnson and Keerthi (IEEE J. Robotics and Automation 4(2), 1988): the distance of two convex
// sets is the distance of the origin from their Minkowski difference, approached by simplices of support
// points. If the cores overlap, van den Bergen's expanding polytope gives the shortest separating
// translation. Both use storage of fixed size on the stack and a bounded number of iterations. Normal and
// points as in Closest.
Closest closest_cores(const ConvexShape& A, const ConvexShape& B, const Pose& X_AB);

}  // namespace multipanda
