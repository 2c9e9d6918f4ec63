#include "core/geometry/shape.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace multipanda {
namespace {

void need_length(double value, const char* what) {
  if (std::isfinite(value) && value >= 0) return;
  throw std::invalid_argument(std::string("shape: ").append(what) +
                              " must be a length of at least 0 m, found " + std::to_string(value));
}
void need_finite(const Vector3& p, const char* what) {
  if (!p.allFinite()) throw std::invalid_argument(std::string("shape: ").append(what) + " must be finite");
}

}  // namespace

ConvexShape ConvexShape::sphere(const Vector3& center, double radius) {
  need_finite(center, "the center");
  need_length(radius, "the radius");
  ConvexShape shape;
  shape.kind = Kind::sphere;
  shape.p0 = shape.p1 = center;
  shape.radius = radius;
  return shape;
}

ConvexShape ConvexShape::capsule(const Vector3& p0, const Vector3& p1, double radius) {
  ConvexShape shape = sphere(p0, radius);
  need_finite(p1, "an end");
  shape.kind = Kind::capsule;
  shape.p1 = p1;
  return shape;
}

ConvexShape ConvexShape::box(const Vector3& size, double radius) {
  for (const double edge : size) need_length(edge, "an edge");
  ConvexShape shape = sphere(Vector3::Zero(), radius);
  shape.kind = Kind::box;
  shape.half = 0.5 * size;
  return shape;
}

ConvexShape ConvexShape::cylinder(double cylinder_radius, double length, double radius) {
  need_length(cylinder_radius, "the cylinder's radius");
  need_length(length, "the cylinder's length");
  ConvexShape shape = sphere(Vector3::Zero(), radius);
  shape.kind = Kind::cylinder;
  shape.half = Vector3(cylinder_radius, 0, 0.5 * length);
  return shape;
}

ConvexShape ConvexShape::hull(std::span<const Vector3> vertices, double radius) {
  if (vertices.empty() || vertices.size() > kMaxShapeVertices) {
    throw std::invalid_argument("shape: 1 to " + std::to_string(kMaxShapeVertices) +
                                " vertices are supported, not " + std::to_string(vertices.size()));
  }
  ConvexShape shape = sphere(Vector3::Zero(), radius);
  shape.kind = Kind::vertices;
  shape.vertex_count = static_cast<std::uint8_t>(vertices.size());
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    need_finite(vertices[i], "a vertex");
    shape.vertex[i] = vertices[i];
  }
  return shape;
}

ConvexShape ConvexShape::half_space() {
  ConvexShape shape;
  shape.kind = Kind::half_space;
  return shape;
}

Vector3 ConvexShape::support(const Vector3& direction) const {
  switch (kind) {
    case Kind::capsule:
      return direction.dot(p1 - p0) > 0 ? p1 : p0;
    case Kind::box:
      return {std::copysign(half.x(), direction.x()), std::copysign(half.y(), direction.y()),
              std::copysign(half.z(), direction.z())};
    case Kind::cylinder: {
      const double across = std::hypot(direction.x(), direction.y());
      const double scale = across > 0 ? half.x() / across : 0;
      return {scale * direction.x(), scale * direction.y(), std::copysign(half.z(), direction.z())};
    }
    case Kind::vertices: {
      std::size_t best = 0;
      double farthest = direction.dot(vertex[0]);
      for (std::size_t i = 1; i < vertex_count; ++i) {
        const double along = direction.dot(vertex[i]);
        if (along > farthest) {
          farthest = along;
          best = i;
        }
      }
      return vertex[best];
    }
    case Kind::sphere:
    case Kind::half_space:
      break;
  }
  return p0;
}

BoundingSphere bounding_sphere(const ConvexShape& shape) {
  using Kind = ConvexShape::Kind;
  switch (shape.kind) {
    case Kind::sphere:
      return {shape.p0, shape.radius};
    case Kind::capsule:
      return {0.5 * (shape.p0 + shape.p1), 0.5 * (shape.p1 - shape.p0).norm() + shape.radius};
    case Kind::box:
    case Kind::cylinder:
      return {Vector3::Zero(), shape.half.norm() + shape.radius};
    case Kind::vertices: {
      // Centered between the extreme coordinates; close enough to the smallest sphere.
      Vector3 low = shape.vertex[0], high = shape.vertex[0];
      for (std::size_t i = 1; i < shape.vertex_count; ++i) {
        low = low.cwiseMin(shape.vertex[i]);
        high = high.cwiseMax(shape.vertex[i]);
      }
      BoundingSphere sphere{0.5 * (low + high), 0};
      for (std::size_t i = 0; i < shape.vertex_count; ++i) {
        sphere.radius = std::max(sphere.radius, (shape.vertex[i] - sphere.center).norm());
      }
      sphere.radius += shape.radius;
      return sphere;
    }
    case Kind::half_space:
      break;
  }
  return {Vector3::Zero(), std::numeric_limits<double>::infinity()};
}

}  // namespace multipanda
