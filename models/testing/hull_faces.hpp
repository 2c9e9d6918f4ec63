#pragma once

#include <vector>

#include "core/types/spatial.hpp"

namespace multipanda::test {

// The faces of the convex hull of a few corners, by brute force: each three corners that have all others on
// one side.
class HullFaces {
 public:
  explicit HullFaces(const std::vector<Vector3>& corners) {
    for (const auto& a : corners) {
      for (const auto& b : corners) {
        for (const auto& c : corners) {
          const Vector3 n = (b - a).cross(c - a);
          if (n.norm() < 1e-9) continue;
          const Vector3 normal = n.normalized();
          bool outermost = true;
          for (const auto& p : corners) outermost = outermost && normal.dot(p - a) < 1e-7;
          if (outermost) faces_.push_back({normal, normal.dot(a)});
        }
      }
    }
  }

  // How far a point is beyond one of the faces [m]; not positive inside.
  double outside(const Vector3& p) const {
    double most = -1e9;
    for (const auto& [normal, offset] : faces_) most = std::max(most, normal.dot(p) - offset);
    return faces_.empty() ? 1e9 : most;
  }
  std::size_t size() const { return faces_.size(); }

 private:
  struct Face {
    Vector3 normal;
    double offset;
  };
  std::vector<Face> faces_;
};

}  // namespace multipanda::test
