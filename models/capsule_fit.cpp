#include "models/capsule_fit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>

#include "common/own_files.hpp"

namespace multipanda {
namespace {

using Points = std::vector<Vector3>;
using Point2 = Eigen::Vector2d;

// Evenly spread unit vectors (Fibonacci lattice).
Points directions(int count) {
  Points result;
  const double golden = M_PI * (3 - std::sqrt(5.0));
  for (int k = 0; k < count; ++k) {
    const double z = 1 - (2 * k + 1.0) / count, r = std::sqrt(1 - z * z);
    result.emplace_back(r * std::cos(golden * k), r * std::sin(golden * k), z);
  }
  return result;
}

double support(const Points& points, const Vector3& d) {
  double most = -std::numeric_limits<double>::infinity();
  for (const auto& p : points) most = std::max(most, d.dot(p));
  return most;
}

// The points that are outermost in some direction: sufficient to compare directions of the axis.
Points outermost(const Points& points) {
  std::vector<std::size_t> kept;
  for (const auto& d : even_directions()) {
    std::size_t best = 0;
    for (std::size_t i = 1; i < points.size(); ++i) {
      if (d.dot(points[i]) > d.dot(points[best])) best = i;
    }
    kept.push_back(best);
  }
  std::sort(kept.begin(), kept.end());
  kept.erase(std::unique(kept.begin(), kept.end()), kept.end());
  Points result;
  for (const std::size_t i : kept) result.push_back(points[i]);
  return result;
}

struct Circle {
  Point2 center = Point2::Zero();
  double radius = 0;
  bool contains(const Point2& p) const { return (p - center).norm() <= radius * (1 + 1e-12) + 1e-15; }
};

Circle around(const Point2& a, const Point2& b) { return {0.5 * (a + b), 0.5 * (a - b).norm()}; }

Circle around(const Point2& a, const Point2& b, const Point2& c) {
  const Point2 u = b - a, v = c - a;
  const double area = 2 * (u.x() * v.y() - u.y() * v.x());
  if (std::abs(area) < 1e-18) {  // collinear: the two that are farthest apart
    Circle widest = around(a, b);
    for (const Circle& other : {around(a, c), around(b, c)}) {
      if (other.radius > widest.radius) widest = other;
    }
    return widest;
  }
  const Point2 offset{(v.y() * u.squaredNorm() - u.y() * v.squaredNorm()) / area,
                      (u.x() * v.squaredNorm() - v.x() * u.squaredNorm()) / area};
  return {a + offset, offset.norm()};
}

// The smallest circle around points (Welzl 1991, iterative). They must be in random order.
Circle smallest_circle(const std::vector<Point2>& points) {
  Circle circle{points[0], 0};
  for (std::size_t i = 1; i < points.size(); ++i) {
    if (circle.contains(points[i])) continue;
    circle = {points[i], 0};
    for (std::size_t j = 0; j < i; ++j) {
      if (circle.contains(points[j])) continue;
      circle = around(points[i], points[j]);
      for (std::size_t k = 0; k < j; ++k) {
        if (!circle.contains(points[k])) circle = around(points[i], points[j], points[k]);
      }
    }
  }
  return circle;
}

// The smallest capsule around the points with its axis along u. Across u it is the smallest circle; a point
// at the distance d from the axis is inside if the segment reaches to sqrt(r^2 - d^2) before it. A larger
// radius with less length may have a smaller volume.
FittedCapsule along(const Points& points, const Vector3& u) {
  const Vector3 x = u.unitOrthogonal(), y = u.cross(x);
  std::vector<Point2> flat;
  for (const auto& p : points) flat.emplace_back(x.dot(p), y.dot(p));
  Circle circle = smallest_circle(flat);
  for (const auto& p : flat)
    circle.radius = std::max(circle.radius, (p - circle.center).norm());  // against rounding
  FittedCapsule best;
  double least = std::numeric_limits<double>::infinity();
  for (int k = 0; k < 10; ++k) {
    const double r = circle.radius * (1 + 0.05 * k);
    double from = std::numeric_limits<double>::infinity(), to = -from;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double d = (flat[i] - circle.center).norm(), t = u.dot(points[i]);
      const double reach = std::sqrt(std::max(0.0, r * r - d * d));
      from = std::min(from, t + reach);
      to = std::max(to, t - reach);
    }
    if (from > to) from = to = 0.5 * (from + to);  // any point between is equivalent
    FittedCapsule capsule;
    const Vector3 middle = circle.center.x() * x + circle.center.y() * y;
    capsule.from = middle + from * u;
    capsule.to = middle + to * u;
    capsule.radius = r;
    if (capsule.volume() < least) {
      least = capsule.volume();
      best = capsule;
    }
  }
  return best;
}

}  // namespace

const Points& even_directions() {
  static const Points kAll = directions(642);
  return kAll;
}

double FittedCapsule::volume() const {
  return M_PI * radius * radius * ((to - from).norm() + 4.0 / 3.0 * radius);
}

FittedCapsule fit_capsule(const Points& points) {
  if (points.empty()) throw std::invalid_argument("expected at least one point to fit a capsule");
  Points shuffled = points;
  std::shuffle(shuffled.begin(), shuffled.end(), std::mt19937(1));
  const Points few = outermost(shuffled);
  Vector3 axis = Vector3::UnitZ();
  double least = std::numeric_limits<double>::infinity();
  const auto attempt = [&](const Vector3& u) {
    const double volume = along(few, u).volume();
    if (volume >= least) return false;
    least = volume;
    axis = u;
    return true;
  };
  Vector3 mean = Vector3::Zero();
  for (const auto& p : few) mean += p / static_cast<double>(few.size());
  Matrix3 spread = Matrix3::Zero();
  for (const auto& p : few) spread += (p - mean) * (p - mean).transpose();
  const Eigen::SelfAdjointEigenSolver<Matrix3> principal(spread);
  for (int k = 0; k < 3; ++k) attempt(principal.eigenvectors().col(k));
  for (const auto& u : directions(120)) {
    if (u.z() >= 0) attempt(u);
  }
  for (double step = 0.15; step > 5e-4; step *= 0.5) {
    for (bool better = true; better;) {
      better = false;
      const Vector3 x = axis.unitOrthogonal(), y = axis.cross(x);
      for (const Vector3& d : {x, y, Vector3(-x), Vector3(-y)}) {
        if (attempt((axis + step * d).normalized())) {
          better = true;
          break;
        }
      }
    }
  }
  FittedCapsule result = along(shuffled, axis);
  // MuJoCo and readers of model files reject capsules without length or radius.
  constexpr double kLeastRadius = 1e-3, kLeastLength = 1e-4;  // [m]
  result.radius = std::max(result.radius, kLeastRadius);
  if ((result.to - result.from).norm() < kLeastLength) {
    const Vector3 middle = 0.5 * (result.from + result.to);
    result.from = middle - 0.5 * kLeastLength * axis;
    result.to = middle + 0.5 * kLeastLength * axis;
    result.radius += 0.5 * kLeastLength;  // so that contained points stay inside
  }
  for (const auto& d : even_directions()) {
    const double reach = std::max(d.dot(result.from), d.dot(result.to)) + result.radius;
    result.excess = std::max(result.excess, reach - support(few, d));
  }
  return result;
}

std::vector<FittedCapsule> fit_capsules(std::vector<Points> shapes, std::size_t most) {
  const std::vector<Points> all = shapes;
  std::vector<FittedCapsule> capsules;
  std::vector<std::vector<std::size_t>> members;  // of each shape: those that share its capsule
  for (std::size_t k = 0; k < shapes.size(); ++k) {
    capsules.push_back(fit_capsule(shapes[k]));
    members.push_back({k});
    shapes[k] = outermost(shapes[k]);  // sufficient to compare unions
  }
  struct Union {
    std::size_t a, b;
    FittedCapsule capsule;
    double cost;  // [m^3]
  };
  std::vector<Union> unions;
  std::vector<bool> gone(shapes.size(), false);
  const auto unite = [&](std::size_t a, std::size_t b) {
    Points both = shapes[a];
    both.insert(both.end(), shapes[b].begin(), shapes[b].end());
    const FittedCapsule capsule = fit_capsule(both);
    unions.push_back({a, b, capsule, capsule.volume() - capsules[a].volume() - capsules[b].volume()});
  };
  std::size_t left = shapes.size();
  for (std::size_t b = 0; b < shapes.size() && left > most; ++b) {
    for (std::size_t a = 0; a < b; ++a) unite(a, b);
  }
  for (; left > most; --left) {
    const Union best = *std::min_element(unions.begin(), unions.end(),
                                         [](const Union& x, const Union& y) { return x.cost < y.cost; });
    const std::size_t a = best.a, b = best.b;
    std::erase_if(unions, [a, b](const Union& u) { return u.a == a || u.b == a || u.a == b || u.b == b; });
    shapes[a].insert(shapes[a].end(), shapes[b].begin(), shapes[b].end());
    shapes[a] = outermost(shapes[a]);
    capsules[a] = best.capsule;
    members[a].insert(members[a].end(), members[b].begin(), members[b].end());
    gone[b] = true;
    for (std::size_t other = 0; other < shapes.size() && left - 1 > most; ++other) {
      if (other != a && !gone[other]) unite(std::min(a, other), std::max(a, other));
    }
  }
  std::vector<FittedCapsule> kept;
  for (std::size_t k = 0; k < capsules.size(); ++k) {
    if (gone[k]) continue;
    Points points;
    for (const std::size_t member : members[k])
      points.insert(points.end(), all[member].begin(), all[member].end());
    kept.push_back(members[k].size() == 1 ? capsules[k] : fit_capsule(points));
  }
  return kept;
}

Points box_points(const Vector3& size) {
  Points points;
  for (const double x : {-0.5, 0.5}) {
    for (const double y : {-0.5, 0.5}) {
      for (const double z : {-0.5, 0.5}) points.push_back(Vector3(x, y, z).cwiseProduct(size));
    }
  }
  return points;
}

Points cylinder_points(double radius, double length) {
  constexpr int kCount = 48;
  const double outer = radius / std::cos(M_PI / kCount);  // the polygon's edges touch the circle
  Points points;
  for (int k = 0; k < kCount; ++k) {
    const double angle = 2 * M_PI * k / kCount;
    for (const double z : {-0.5, 0.5})
      points.emplace_back(outer * std::cos(angle), outer * std::sin(angle), z * length);
  }
  return points;
}

Points sphere_points(double radius) {
  Points points;
  // No point of the sphere is farther than 0.1 rad from a direction: 1 / cos(0.1) = 1.005.
  for (const auto& d : even_directions()) points.push_back(1.006 * radius * d);
  return points;
}

std::vector<Vector3> mesh_points(const std::filesystem::path& file, const Vector3& scale) {
  static const auto read = reinterpret_cast<decltype(&multipanda_read_mesh)>(
      from_own_library("libmultipanda_meshes.so", "multipanda_read_mesh"));
  std::vector<Vector3> points;
  read(file, scale, points);
  for (const auto& p : points) {
    if (!p.allFinite())
      throw std::invalid_argument("the mesh " + file.string() + " has a point that is not finite");
  }
  // In STL files triangles do not share corners.
  const auto before = [](const Vector3& a, const Vector3& b) {
    return std::lexicographical_compare(a.begin(), a.end(), b.begin(), b.end());
  };
  std::sort(points.begin(), points.end(), before);
  points.erase(std::unique(points.begin(), points.end()), points.end());
  return points;
}

}  // namespace multipanda
