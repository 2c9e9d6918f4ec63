#pragma once

#include "core/geometry/shape.hpp"

namespace multipanda {

// Where two bodies are closest to each other. Bodies that overlap have a negative distance: minus the
// shortest way to move one of them until they only touch.
struct Closest {
  double distance = 0;                // between the surfaces [m]
  Vector3 p_A = Vector3::Zero();      // on the surface of A
  Vector3 p_B = Vector3::Zero();      // on the surface of B; p_A - p_B = distance * normal
  Vector3 normal = Vector3::UnitZ();  // from B to A, unit length: the way in which A gets away
};

// Two capsules, closed form. End points and results in the same frame; a segment may be a point. Parallel
// segments: one of the many closest pairs. Segments that cross: the normal is perpendicular to both.
Closest closest_capsules(const Vector3& a0, const Vector3& a1, double radius_a, const Vector3& b0,
                         const Vector3& b1, double radius_b);

// A capsule and the half space on the negative side of a plane through p_WO with that unit normal. Closed
// form.
Closest closest_capsule_half_space(const Vector3& a0, const Vector3& a1, double radius, const Vector3& point,
                                   const Vector3& normal);

// Any two shapes, X_WA and X_WB their frames in the world, results in the world. Capsules, spheres and half
// spaces take their closed forms, the others GJK on the cores; cores that overlap the expanding polytope of
// their difference, of bounded size. Distance within 1e-8 m. Never allocates, bounded time.
// Two half spaces: distance 0 (they always meet or do not, nobody asks).
Closest closest_points(const ConvexShape& A, const Pose& X_WA, const ConvexShape& B, const Pose& X_WB);

}  // namespace multipanda
