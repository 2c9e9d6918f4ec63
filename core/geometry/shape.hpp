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

}  // namespace multipanda
