#pragma once

#include <algorithm>
#include <utility>

#include "core/geometry/shape.hpp"

// The definition of core/geometry/shape.hpp by search: the bodies' cores are replaced by spheres at
// a(x) and b(y), and the sum of distance and preference is minimized by ternary sections. It is convex.
namespace multipanda::test {

template <typename F>
double smallest_value(F f) {
  double low = -1, high = 1;
  for (int round = 0; round < 90; ++round) {
    const double a = low + (high - low) / 3, b = high - (high - low) / 3;
    (f(a) < f(b) ? high : low) = f(a) < f(b) ? b : a;
  }
  return std::min({f(0.5 * (low + high)), f(-1), f(1)});
}

inline double preference(double half_length, double x) {
  return std::min(kEven, half_length / 4) * (x * x - 1);
}

inline double smooth_reference(const ConvexShape& A, const Pose& X_WA, const ConvexShape& B,
                               const Pose& X_WB) {
  using Kind = ConvexShape::Kind;
  const auto swap = [&] { return smooth_reference(B, X_WB, A, X_WA); };
  const auto plain = [](const ConvexShape& a, const Pose& X_a, const ConvexShape& b, const Pose& X_b) {
    return closest_points(a, X_a, b, X_b).distance;
  };
  if (A.kind == Kind::half_space) return swap();
  if (B.kind != Kind::half_space && plain(A, X_WA, B, X_WB) + A.radius + B.radius <= kSmoothCores)
    return plain(A, X_WA, B, X_WB);
  if (A.kind == Kind::capsule) {
    const Vector3 middle = 0.5 * (A.p0 + A.p1), half = 0.5 * (A.p1 - A.p0);
    return smallest_value([&](double x) {
      const ConvexShape point = ConvexShape::sphere(middle + x * half, A.radius);
      const double rest =
          B.kind == Kind::capsule ? smooth_reference(B, X_WB, point, X_WA) : plain(point, X_WA, B, X_WB);
      return rest + preference(half.norm(), x);
    });
  }
  if (A.kind == Kind::box && B.kind == Kind::half_space) {  // each axis for itself: the distance is linear
    Vector3 x = Vector3::Zero();
    const double at_middle = plain(ConvexShape::sphere({0, 0, 0}, A.radius), X_WA, B, X_WB);
    double d = at_middle;
    for (Eigen::Index k = 0; k < 3; ++k) {
      d += smallest_value([&](double s) {
        x.setZero();
        x[k] = s * A.half[k];
        return plain(ConvexShape::sphere(x, A.radius), X_WA, B, X_WB) - at_middle + preference(A.half[k], s);
      });
    }
    return d;
  }
  return B.kind == Kind::capsule ? swap() : plain(A, X_WA, B, X_WB);
}

}  // namespace multipanda::test
