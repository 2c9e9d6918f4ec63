#pragma once

#include <filesystem>
#include <vector>

#include "core/types/spatial.hpp"

// Capsules around the shapes of a URDF, for collision avoidance and self-collision.
namespace multipanda {

struct FittedCapsule {
  Vector3 from = Vector3::Zero(), to = Vector3::Zero();  // ends of the segment [m]
  double radius = 0;                                     // [m]
  double excess = 0;  // largest distance between its surface and the points' convex hull [m], over 642
                      // directions

  double volume() const;
};

// A small capsule that contains all points: the axis direction is searched, everything else follows from it.
// Throws std::invalid_argument without points.
FittedCapsule fit_capsule(const std::vector<Vector3>& points);

// 642 unit vectors all around: every direction is within 0.1 rad of one of them.
const std::vector<Vector3>& even_directions();

// Points whose convex hull contains the shape, in its own frame; round ones are at most 0.6 % too large.
std::vector<Vector3> box_points(const Vector3& size);                // full edge lengths [m]
std::vector<Vector3> cylinder_points(double radius, double length);  // along z, the origin in its middle
std::vector<Vector3> sphere_points(double radius);
// Vertices of a mesh file (STL, OBJ, DAE, ...), each number multiplied by `scale`. Throws
// std::invalid_argument if it cannot be read.
std::vector<Vector3> mesh_points(const std::filesystem::path& file, const Vector3& scale);
// Its part in a library that is loaded with the first mesh (mesh_module.cpp): all vertices in the order of
// the file.
extern "C" void multipanda_read_mesh(const std::filesystem::path& file, const Vector3& scale,
                                     std::vector<Vector3>& points);

// The same for several shapes; shapes whose union adds the least volume are merged until `most` are left.
std::vector<FittedCapsule> fit_capsules(std::vector<std::vector<Vector3>> shapes, std::size_t most);

// Convex polytopes around large bodies, such as the torso that carries an arm: capsules would be far too wide
// for them.

struct FittedHull {
  std::vector<Vector3> corners;  // at most 32, as many as a ConvexShape has [m]
  double excess = 0;  // largest distance between its surface and the points' convex hull [m], over 642
                      // directions
};

// A small polytope that contains all points. It is the intersection of at most 18 half-spaces, so it has at
// most
// 2 x 18 - 4 corners (Euler). Each plane is added where the polytope reaches farthest beyond the points,
// until that is less than kTightHull. At least 1 mm thick. Throws std::invalid_argument without points.
inline constexpr double kTightHull = 0.01;  // [m]
FittedHull fit_hull(const std::vector<Vector3>& points);

// The same for several shapes; shapes whose common hull grows least are merged until `most` are left. Results
// are convex: gaps of bent bodies are filled.
std::vector<FittedHull> fit_hulls(std::vector<std::vector<Vector3>> shapes, std::size_t most);

// Whether the hull of these corners overlaps a capsule; accurate to about a millimeter.
bool hull_overlaps(const std::vector<Vector3>& corners, const Vector3& from, const Vector3& to,
                   double radius);

}  // namespace multipanda
