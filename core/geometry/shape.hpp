#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>

#include "core/types/spatial.hpp"

namespace multipanda {

inline constexpr std::size_t kMaxShapeVertices = 32;

// A convex body: all points within `radius` of a convex core. The core is a point (sphere), a segment
// (capsule), a box, a cylinder or the hull of some vertices; or the half space z <= 0 of its own frame. All
// in the frame S of the shape [m]. Plain data, fixed capacity: copying never allocates.
struct ConvexShape {
  enum class Kind : std::uint8_t { sphere, capsule, box, cylinder, vertices, half_space };
  Kind kind = Kind::sphere;
  double radius = 0;               // swept over the core; 0 for bodies with edges
  Vector3 p0 = Vector3::Zero();    // sphere: center; capsule: one end of the segment
  Vector3 p1 = Vector3::Zero();    // capsule: the other end
  Vector3 half = Vector3::Zero();  // box: half edges; cylinder about z: (core radius, -, half length)
  std::uint8_t vertex_count = 0;   // vertices
  std::array<Vector3, kMaxShapeVertices> vertex{};

  // Not for the loop. Throw std::invalid_argument for lengths that are negative or not finite, and for fewer
  // than 1 or more than kMaxShapeVertices vertices.
  static ConvexShape sphere(const Vector3& center, double radius);
  static ConvexShape capsule(const Vector3& p0, const Vector3& p1, double radius);
  static ConvexShape box(const Vector3& size, double radius = 0);  // full edge lengths, centered
  static ConvexShape cylinder(double cylinder_radius, double length, double radius = 0);  // along z, centered
  static ConvexShape hull(std::span<const Vector3> vertices, double radius = 0);
  static ConvexShape half_space();  // z <= 0

  // The point of the core farthest along `direction` (any length). Not for half_space.
  Vector3 support(const Vector3& direction) const;
};

// A sphere that contains a shape, in the frame of the shape. It is infinite for a half space.
struct BoundingSphere {
  Vector3 center = Vector3::Zero();
  double radius = 0;
};
BoundingSphere bounding_sphere(const ConvexShape& shape);

// A fixed object in the world, such as a table, a wall or the floor. Nothing pushes it, but the timeline of a
// simulation may place it elsewhere.
struct Obstacle {
  std::string name;
  ConvexShape shape;
  Pose X_WO;               // the shape's frame in the world
  bool is_placed = false;  // a simulation may move it during the run
};

// Closest points of two bodies. If they overlap, the distance is negative: minus the shortest translation of
// one of them that separates them.
struct Closest {
  double distance = 0;                // between the surfaces [m]
  Vector3 p_A = Vector3::Zero();      // on the surface of A
  Vector3 p_B = Vector3::Zero();      // on the surface of B; p_A - p_B = distance * normal
  Vector3 normal = Vector3::UnitZ();  // from B to A, unit length: the direction in which A separates
};

// Distance of two capsules in closed form. End points and results are in the same frame; a segment may be a
// point. For parallel segments, returns one of the closest pairs. If the segments cross, the normal is
// perpendicular to both.
Closest closest_capsules(const Vector3& a0, const Vector3& a1, double radius_a, const Vector3& b0,
                         const Vector3& b1, double radius_b);

// A capsule and the half space on the negative side of a plane through p_WO with that unit
// normal; closed form.
Closest closest_capsule_half_space(const Vector3& a0, const Vector3& a1, double radius, const Vector3& point,
                                   const Vector3& normal);

// Distance of any two shapes with frames X_WA and X_WB in the world; results in the world. Capsules, spheres
// and half spaces use closed forms. All others use GJK on the cores, and an expanding polytope of bounded
// size if the cores overlap. Accurate to 1e-8 m. Never allocates; bounded time. Two half spaces are not
// supported: the distance is 0.
Closest closest_points(const ConvexShape& A, const Pose& X_WA, const ConvexShape& B, const Pose& X_WB);

// Closest points of two convex cores (radius left out, no half spaces), everything in A's frame; X_AB places
// B. Gilbert, Johnson and Keerthi (IEEE J. Robotics and Automation 4(2), 1988): the distance of two convex
// sets is the distance of the origin from their Minkowski difference, approached by simplices of support
// points. If the cores overlap, van den Bergen's expanding polytope gives the shortest separating
// translation. Both use storage of fixed size on the stack and a bounded number of iterations. Normal and
// points as in Closest.
Closest closest_cores(const ConvexShape& A, const ConvexShape& B, const Pose& X_AB);

// Distances whose closest points move continuously with the bodies, for forces.
//
// The closest points of parallel edges and faces jump from end to end with any small turn, and with them the
// torque of a force between them. So here a straight core (a capsule's segment; a box above a half space) has
// a preference for its middle: with a(x), x from -1 to 1 along the core,
//
//   d = min over x (and y of the other core) of |a(x) - b(y)| + e_a (x^2 - 1) + e_b (y^2 - 1) - radii.
//
// The minimum is unique and its place continuous. The gradient of d is that of |a - b| with x and y kept
// (envelope theorem): a force along `normal` at p_A and p_B is the exact gradient of any function of d. Where
// the closest point is an end of the core, d is the distance; elsewhere it is smaller, by e at most for each
// core: never on the unsafe side. e is kEven, or a quarter of the core's half length if that is less: a core
// of half length h takes its end from a tilt of 2 e / h on (0.08 rad for h = 0.05 m).
//
// p_A and p_B lie on the surfaces; they are farther apart than `distance` says. The cores must be apart by
// more than kSmoothCores (see `exact`, the result of closest_points for the same bodies); otherwise, and for
// pairs without a straight core, the result is `exact`. Nothing allocates; bounded time.
inline constexpr double kEven = 0.002;        // [m]
inline constexpr double kSmoothCores = 1e-6;  // [m]

Closest smooth_capsules(const Vector3& a0, const Vector3& a1, double radius_a, const Vector3& b0,
                        const Vector3& b1, double radius_b, const Closest& exact);
Closest smooth_capsule_half_space(const Vector3& a0, const Vector3& a1, double radius, const Vector3& point,
                                  const Vector3& normal);
Closest smooth_points(const ConvexShape& A, const Pose& X_WA, const ConvexShape& B, const Pose& X_WB,
                      const Closest& exact);

}  // namespace multipanda
