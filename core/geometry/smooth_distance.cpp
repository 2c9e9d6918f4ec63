
#include <algorithm>
#include <cmath>

#include "core/geometry/shape.hpp"

namespace multipanda {
namespace {

using Kind = ConvexShape::Kind;

// A straight core as its middle and half of its length; a(x) = middle + x half.
struct Core {
  Core(const Vector3& p0, const Vector3& p1)
      : middle(0.5 * (p0 + p1)), half(0.5 * (p1 - p0)), even(std::min(kEven, 0.25 * half.norm())) {}
  Vector3 at(double x) const { return middle + x * half; }
  double bonus(double x) const { return even * (x * x - 1); }
  Vector3 middle, half;
  double even;  // e [m]
};

double to_range(double x) { return std::clamp(x, -1.0, 1.0); }

Closest between(const Vector3& a, const Vector3& b, double gap, double bonus, double radius_a,
                double radius_b) {
  const Vector3 normal = (a - b) / gap;
  return {gap + bonus - radius_a - radius_b, a - radius_a * normal, b + radius_b * normal, normal};
}

double core_gap(const Closest& exact, double radius_a, double radius_b) {
  return exact.distance + radius_a + radius_b;
}

// The point of B's core nearest to p, both in B's frame.
Vector3 nearest_of_core(const ConvexShape& B, const Vector3& p) {
  switch (B.kind) {
    case Kind::box:
      return p.cwiseMax(-B.half).cwiseMin(B.half);
    case Kind::cylinder: {
      const double away = p.head<2>().norm();
      Vector3 nearest = p;
      if (away > B.half.x()) nearest.head<2>() *= B.half.x() / away;
      nearest.z() = std::clamp(p.z(), -B.half.z(), B.half.z());
      return nearest;
    }
    case Kind::sphere:
      return B.p0;
    default: {
      ConvexShape point;  // a sphere of radius 0
      return closest_cores(point, B, {Matrix3::Identity(), -p}).p_B + p;
    }
  }
}

// A straight core and any other one. The derivative along the core, n . half + 2 e x, grows with x: its zero,
// or an end.
Closest segment_to_core(const Core& A, double radius_a, const ConvexShape& B, const Pose& X_WB,
                        const Closest& exact) {
  const Pose X_BW = X_WB.inverse();
  Vector3 a = A.middle, b = a;
  double gap = 0;
  const auto slope = [&](double x) {
    a = A.at(x);
    b = X_WB * nearest_of_core(B, X_BW * a);
    gap = (a - b).norm();
    return gap > 0 ? (a - b).dot(A.half) / gap + 2 * A.even * x : 0;
  };
  double low = -1, high = 1, x = high;
  double at_low = slope(low), at_high = slope(high);
  if (at_low >= 0) {
    x = low;
  } else if (at_high > 0) {
    // Illinois: the secant, halving the value of an end that stays.
    constexpr int kRounds = 60;
    constexpr double kExact = 1e-13;  // [m]
    int stayed = 0;
    for (int round = 0; round < kRounds; ++round) {
      x = (low * at_high - high * at_low) / (at_high - at_low);
      const double at_x = slope(x);
      if (std::abs(at_x) < kExact || high - low < kExact) break;
      if (at_x > 0) {
        high = x;
        at_high = at_x;
        if (stayed == 1) at_low *= 0.5;
        stayed = 1;
      } else {
        low = x;
        at_low = at_x;
        if (stayed == -1) at_high *= 0.5;
        stayed = -1;
      }
    }
  }
  (void)slope(x);
  if (!(gap > kSmoothCores)) return exact;
  return between(a, b, gap, A.bonus(x), radius_a, B.radius);
}

// A box prefers its middle along each of its edges.
Closest box_to_half_space(const ConvexShape& A, const Pose& X_WA, const Pose& X_WB) {
  const Vector3 n = X_WB.rotation.col(2);
  const Vector3 along = X_WA.rotation.transpose() * n;
  Vector3 p = Vector3::Zero();
  double bonus = 0;
  for (Eigen::Index k = 0; k < 3; ++k) {
    const double even = std::min(kEven, 0.25 * A.half[k]);
    if (even <= 0) continue;
    const double x = to_range(-along[k] * A.half[k] / (2 * even));
    p[k] = x * A.half[k];
    bonus += even * (x * x - 1);
  }
  const Vector3 a = X_WA * p;
  const double apart = n.dot(a - X_WB.position);
  return {apart + bonus - A.radius, a - A.radius * n, a - apart * n, n};
}

bool straight(const ConvexShape& shape) { return shape.kind == Kind::capsule; }
bool point_like(const ConvexShape& shape) {
  return shape.kind == Kind::capsule || shape.kind == Kind::sphere;
}

Closest with_bodies_swapped(const Closest& c) { return {c.distance, c.p_B, c.p_A, -c.normal}; }

}  // namespace

// With the gap g known, the condition of the minimum is that of a quadratic problem: |a(x) - b(y)|^2 / 2 +
// g e_a x^2 + g e_b y^2. Its minimum gives the next g, which converges within a few rounds since e is small.
Closest smooth_capsules(const Vector3& a0, const Vector3& a1, double radius_a, const Vector3& b0,
                        const Vector3& b1, double radius_b, const Closest& exact) {
  const Core A(a0, a1), B(b0, b1);
  double gap = core_gap(exact, radius_a, radius_b);
  if (!(gap > kSmoothCores)) return exact;
  const Vector3 w = A.middle - B.middle;
  const double uv = A.half.dot(B.half), uw = A.half.dot(w), vw = B.half.dot(w);
  const double u2 = A.half.squaredNorm(), v2 = B.half.squaredNorm();
  constexpr int kRounds = 20;
  constexpr double kPoint = 1e-12;  // half length below which a core is a point [m]
  double x = 0, y = 0;
  for (int round = 0; round < kRounds; ++round) {
    const double uu = u2 + 2 * gap * A.even, vv = v2 + 2 * gap * B.even;
    x = y = 0;
    if (u2 > kPoint * kPoint && v2 > kPoint * kPoint) {
      x = to_range((uv * vw - vv * uw) / (uu * vv - uv * uv));
      const double free_y = (uv * x + vw) / vv;
      y = to_range(free_y);
      if (y != free_y) x = to_range((uv * y - uw) / uu);
    } else if (u2 > kPoint * kPoint) {
      x = to_range(-uw / uu);
    } else if (v2 > kPoint * kPoint) {
      y = to_range(vw / vv);
    }
    const double next = (A.at(x) - B.at(y)).norm();
    if (!(next > kSmoothCores)) return exact;
    const double change = std::abs(next - gap);
    gap = next;
    if (change < 1e-14) break;
  }
  return between(A.at(x), B.at(y), gap, A.bonus(x) + B.bonus(y), radius_a, radius_b);
}

Closest smooth_capsule_half_space(const Vector3& a0, const Vector3& a1, double radius, const Vector3& point,
                                  const Vector3& normal) {
  const Core A(a0, a1);
  const double x = A.even > 0 ? to_range(-normal.dot(A.half) / (2 * A.even)) : 0;
  const Vector3 a = A.at(x);
  const double apart = normal.dot(a - point);
  return {apart + A.bonus(x) - radius, a - radius * normal, a - apart * normal, normal};
}

Closest smooth_points(const ConvexShape& A, const Pose& X_WA, const ConvexShape& B, const Pose& X_WB,
                      const Closest& exact) {
  if (B.kind == Kind::half_space) {
    if (point_like(A)) {
      const Vector3 p0 = X_WA * A.p0, p1 = straight(A) ? Vector3(X_WA * A.p1) : p0;
      return smooth_capsule_half_space(p0, p1, A.radius, X_WB.position, X_WB.rotation.col(2));
    }
    return A.kind == Kind::box ? box_to_half_space(A, X_WA, X_WB) : exact;
  }
  if (A.kind == Kind::half_space)
    return with_bodies_swapped(smooth_points(B, X_WB, A, X_WA, with_bodies_swapped(exact)));
  if (!(core_gap(exact, A.radius, B.radius) > kSmoothCores)) return exact;
  if (point_like(A) && point_like(B)) {
    const Vector3 a0 = X_WA * A.p0, a1 = straight(A) ? Vector3(X_WA * A.p1) : a0;
    const Vector3 b0 = X_WB * B.p0, b1 = straight(B) ? Vector3(X_WB * B.p1) : b0;
    return smooth_capsules(a0, a1, A.radius, b0, b1, B.radius, exact);
  }
  if (straight(A)) return segment_to_core(Core(X_WA * A.p0, X_WA * A.p1), A.radius, B, X_WB, exact);
  if (straight(B)) {
    const Core core(X_WB * B.p0, X_WB * B.p1);
    return with_bodies_swapped(segment_to_core(core, B.radius, A, X_WA, with_bodies_swapped(exact)));
  }
  return exact;
}

}  // namespace multipanda
