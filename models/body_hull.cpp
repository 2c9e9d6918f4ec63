#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include <Eigen/LU>

#include "models/capsule_fit.hpp"

namespace multipanda {
namespace {

using Points = std::vector<Vector3>;

constexpr std::size_t kMostPlanes = 18;
constexpr double kLeastThickness = 1e-3;  // [m]

struct Plane {
  Vector3 normal;  // outwards, unit length
  double offset;   // normal . p for its points [m]
};

double reach_of(const Points& points, const Vector3& d) {
  double most = -std::numeric_limits<double>::infinity();
  for (const auto& p : points) most = std::max(most, d.dot(p));
  return most;
}

// Three planes meet in a corner if their common point is behind all other planes.
Points corners_of(const std::vector<Plane>& planes) {
  constexpr double kFlat = 1e-6, kOutside = 1e-9, kSame = 1e-6;  // determinant; [m]
  Points corners;
  for (std::size_t a = 0; a < planes.size(); ++a) {
    for (std::size_t b = a + 1; b < planes.size(); ++b) {
      for (std::size_t c = b + 1; c < planes.size(); ++c) {
        Matrix3 N;
        N << planes[a].normal.transpose(), planes[b].normal.transpose(), planes[c].normal.transpose();
        if (std::abs(N.determinant()) < kFlat) continue;
        const Vector3 p = N.inverse() * Vector3(planes[a].offset, planes[b].offset, planes[c].offset);
        const bool inside = std::all_of(planes.begin(), planes.end(), [&](const Plane& plane) {
          return plane.normal.dot(p) <= plane.offset + kOutside;
        });
        const bool known = std::any_of(corners.begin(), corners.end(),
                                       [&](const Vector3& q) { return (p - q).norm() <= kSame; });
        if (inside && !known) corners.push_back(p);
      }
    }
  }
  return corners;
}

// Normals of the faces, edges and corners of a box along the frame's axes, which fit most machine parts, then
// directions all around.
const Points& candidates() {
  static const Points kAll = [] {
    Points all;
    for (int x = -1; x <= 1; ++x) {
      for (int y = -1; y <= 1; ++y) {
        for (int z = -1; z <= 1; ++z) {
          const Vector3 d(x, y, z);
          if (!d.isZero()) all.push_back(d.normalized());
        }
      }
    }
    all.insert(all.end(), even_directions().begin(), even_directions().end());
    return all;
  }();
  return kAll;
}

// Mean width [m], a measure of size: a body that contains another has a larger one.
double width_of_both(const Points& a, const Points& b) {
  double sum = 0;
  for (const auto& d : even_directions()) sum += std::max(reach_of(a, d), reach_of(b, d));
  return 2 * sum / static_cast<double>(even_directions().size());
}
double width(const Points& points) { return width_of_both(points, points); }

}  // namespace

FittedHull fit_hull(const Points& points) {
  if (points.empty()) throw std::invalid_argument("expected at least one point to fit a hull");
  std::vector<double> reached;  // by the points
  for (const auto& d : candidates()) reached.push_back(reach_of(points, d));
  std::vector<Plane> planes;
  for (Eigen::Index i = 0; i < 3; ++i) {
    const Vector3 d = Vector3::Unit(i);
    const double high = reach_of(points, d), low = -reach_of(points, -d);
    const double wider = std::max(0.0, 0.5 * (kLeastThickness - (high - low)));
    planes.push_back({d, high + wider});
    planes.push_back({-d, wider - low});
  }
  FittedHull hull{.corners = corners_of(planes)};
  constexpr double kEqual = 1e-9;  // so that rounding does not decide [m]
  while (true) {
    std::size_t worst = 0;
    hull.excess = -std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < candidates().size(); ++k) {
      const double excess = reach_of(hull.corners, candidates()[k]) - reached[k];
      if (excess <= hull.excess + kEqual) continue;
      hull.excess = excess;
      worst = k;
    }
    if (hull.excess <= kTightHull || planes.size() == kMostPlanes) return hull;
    planes.push_back({candidates()[worst], reached[worst] + 0.5 * kLeastThickness});
    hull.corners = corners_of(planes);
  }
}

std::vector<FittedHull> fit_hulls(std::vector<Points> shapes, std::size_t most) {
  std::vector<FittedHull> hulls;
  for (const Points& shape : shapes) hulls.push_back(fit_hull(shape));
  while (hulls.size() > most) {
    std::size_t a = 0, b = 1;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t j = 0; j < hulls.size(); ++j) {
      for (std::size_t i = 0; i < j; ++i) {
        const double wider = width_of_both(hulls[i].corners, hulls[j].corners) -
                             std::max(width(hulls[i].corners), width(hulls[j].corners));
        if (wider >= least) continue;
        least = wider;
        a = i;
        b = j;
      }
    }
    shapes[a].insert(shapes[a].end(), shapes[b].begin(), shapes[b].end());
    hulls[a] = fit_hull(shapes[a]);
    shapes.erase(shapes.begin() + static_cast<std::ptrdiff_t>(b));
    hulls.erase(hulls.begin() + static_cast<std::ptrdiff_t>(b));
  }
  return hulls;
}

// The point p of {corner - segment} nearest to the origin, by the pairwise Frank-Wolfe method: its length
// bounds the distance from above, its direction from below.
bool hull_overlaps(const Points& corners, const Vector3& from, const Vector3& to, double radius) {
  constexpr int kRounds = 200;
  Points ends;
  for (const auto& corner : corners) {
    ends.push_back(corner - from);
    ends.push_back(corner - to);
  }
  std::vector<double> weight(ends.size(), 0);  // p as weighted mean of `ends`
  weight[0] = 1;
  Vector3 p = ends[0];
  for (int k = 0; k < kRounds; ++k) {
    const double length = p.norm();
    if (length <= radius) return true;
    std::size_t near = 0, away = ends.size();
    for (std::size_t i = 0; i < ends.size(); ++i) {
      if (p.dot(ends[i]) < p.dot(ends[near])) near = i;
      if (weight[i] > 0 && (away == ends.size() || p.dot(ends[i]) > p.dot(ends[away]))) away = i;
    }
    if (p.dot(ends[near]) > radius * length) return false;
    const Vector3 d = ends[near] - ends[away];
    if (!(d.squaredNorm() > 0)) return false;
    const double share = std::clamp(-p.dot(d) / d.squaredNorm(), 0.0, weight[away]);
    weight[away] -= share;
    weight[near] += share;
    p += share * d;
  }
  return true;
}

}  // namespace multipanda
