#pragma once

#include <filesystem>
#include <vector>

#include "core/types/spatial.hpp"

// Capsules around the shapes of a URDF: collision avoidance and self-collision know capsules only.
namespace multipanda {

struct FittedCapsule {
  Vector3 from = Vector3::Zero(), to = Vector3::Zero();  // ends of the segment [m]
  double radius = 0;                                     // [m]
  double excess = 0;  // largest distance of its surface from the points' convex hull [m], over 642 directions

  double volume() const;
};

// A small capsule that contains all points: the direction of its axis is searched, everything else follows
// from it. Throws std::invalid_argument without points.
FittedCapsule fit_capsule(const std::vector<Vector3>& points);

// 642 unit vectors all around: no direction is farther than 0.1 rad from one of them.
const std::vector<Vector3>& even_directions();

// Points whose convex hull contains the shape, in its own frame; round ones are at most 0.6 % too large.
std::vector<Vector3> box_points(const Vector3& size);                // full edge lengths [m]
std::vector<Vector3> cylinder_points(double radius, double length);  // along z, the origin in its middle
std::vector<Vector3> sphere_points(double radius);
// Vertices of a mesh file (STL, OBJ, DAE, ...), each number multiplied by `scale`. Throws
// std::invalid_argument if it cannot be read.
std::vector<Vector3> mesh_points(const std::filesystem::path& file, const Vector3& scale);

// The same for several shapes; those whose union adds the least volume share one, until `most` are left.
std::vector<FittedCapsule> fit_capsules(std::vector<std::vector<Vector3>> shapes, std::size_t most);

// Distance of two segments [m], closed form.
double segment_distance(const Vector3& a0, const Vector3& a1, const Vector3& b0, const Vector3& b1);

}  // namespace multipanda
