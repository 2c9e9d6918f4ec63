#include <algorithm>
#include <cmath>

#include "core/geometry/shape.hpp"

namespace multipanda {
namespace {

using Kind = ConvexShape::Kind;

double to_unit(double t) { return std::clamp(t, 0.0, 1.0); }

// A direction perpendicular to `a`.
Vector3 unit_across(const Vector3& a) {
  const Vector3 axis = std::abs(a.x()) < 0.6 * a.norm() ? Vector3(1, 0, 0) : Vector3(0, 1, 0);
  const Vector3 c = a.cross(axis);
  const double length = c.norm();
  return length > 0 ? Vector3(c / length) : Vector3(0, 0, 1);
}

// Closest points of bodies whose cores have the closest points a and b, at distance `apart` along `normal`
// (from b to a).
Closest swept(const Vector3& a, const Vector3& b, double apart, const Vector3& normal, double radius_a,
              double radius_b) {
  return {apart - radius_a - radius_b, a - radius_a * normal, b + radius_b * normal, normal};
}

bool is_segment(const ConvexShape& shape) {
  return shape.kind == Kind::capsule || shape.kind == Kind::sphere;
}

// B is a half space.
Closest to_half_space(const ConvexShape& A, const Pose& X_WA, const Pose& X_WB) {
  const Vector3 n = X_WB.rotation.col(2);
  const Vector3 deepest = X_WA * A.support(-(X_WA.rotation.transpose() * n));
  const double apart = n.dot(deepest - X_WB.position);
  return swept(deepest, deepest - apart * n, apart, n, A.radius, 0);
}

Closest mirrored(const Closest& c) { return {c.distance, c.p_B, c.p_A, -c.normal}; }

}  // namespace

// Minimizes |a0 + s u - b0 - t v|^2 over the unit square: takes the unconstrained minimum in s, clamped, and
// the best t for it; if t is clamped, the best s for that.
Closest closest_capsules(const Vector3& a0, const Vector3& a1, double radius_a, const Vector3& b0,
                         const Vector3& b1, double radius_b) {
  const Vector3 u = a1 - a0, v = b1 - b0, w = a0 - b0;
  const double uu = u.dot(u), vv = v.dot(v), uv = u.dot(v), uw = u.dot(w), vw = v.dot(w);
  constexpr double kPoint = 1e-24;  // squared length below which a segment is a point [m^2]
  double s = 0, t = 0;
  if (uu > kPoint && vv > kPoint) {
    const auto finish = [&](double& s_k, double& t_k) {
      const double free_t = (uv * s_k + vw) / vv;
      t_k = to_unit(free_t);
      if (t_k != free_t) s_k = to_unit((uv * t_k - uw) / uu);
    };
    const double determinant = uu * vv - uv * uv;
    if (determinant > 1e-8 * uu * vv) {
      s = to_unit((uv * vw - vv * uw) / determinant);
      finish(s, t);
    } else {
      // If the segments are nearly parallel, the quotient is inaccurate. Start at the middle of their
      // overlap, so that the pair does not jump from end to end. Take the quotient or an end only if
      // it is nearer.
      const double from = -uw / uu, to = (uv - uw) / uu;  // b0, b1 along A
      s = 0.5 * (to_unit(from) + to_unit(to));
      finish(s, t);
      const double quotient = determinant > 0 ? to_unit((uv * vw - vv * uw) / determinant) : s;
      double nearest = (w + s * u - t * v).norm() - 1e-12;
      for (double s_k : {quotient, 0.0, 1.0, to_unit(from), to_unit(to)}) {
        double t_k = 0;
        finish(s_k, t_k);
        const double apart = (w + s_k * u - t_k * v).norm();
        if (apart >= nearest) continue;
        nearest = apart;
        s = s_k;
        t = t_k;
      }
    }
  } else if (uu > kPoint) {
    s = to_unit(-uw / uu);
  } else if (vv > kPoint) {
    t = to_unit(vw / vv);
  }
  const Vector3 a = a0 + s * u, b = b0 + t * v, gap = a - b;
  const double apart = gap.norm();
  // If the cores cross, separate them along their common perpendicular, on the side of their midpoints.
  constexpr double kCrossing = 1e-12;  // [m]
  if (apart > kCrossing) return swept(a, b, apart, gap / apart, radius_a, radius_b);
  Vector3 normal = u.cross(v);
  const double length = normal.norm();
  normal = length > 1e-12 * std::sqrt(uu * vv) && length > 0 ? Vector3(normal / length)
                                                             : unit_across(uu > vv ? u : v);
  if (normal.dot(w + 0.5 * (u - v)) < 0) normal = -normal;
  return swept(a, b, apart, normal, radius_a, radius_b);
}

Closest closest_capsule_half_space(const Vector3& a0, const Vector3& a1, double radius, const Vector3& point,
                                   const Vector3& normal) {
  const double end0 = normal.dot(a0 - point), end1 = normal.dot(a1 - point);
  const Vector3& deepest = end1 < end0 ? a1 : a0;
  const double apart = std::min(end0, end1);
  return swept(deepest, deepest - apart * normal, apart, normal, radius, 0);
}

Closest closest_points(const ConvexShape& A, const Pose& X_WA, const ConvexShape& B, const Pose& X_WB) {
  if (B.kind == Kind::half_space) {
    return A.kind == Kind::half_space ? Closest{} : to_half_space(A, X_WA, X_WB);
  }
  if (A.kind == Kind::half_space) return mirrored(to_half_space(B, X_WB, X_WA));
  if (is_segment(A) && is_segment(B)) {
    return closest_capsules(X_WA * A.p0, X_WA * A.p1, A.radius, X_WB * B.p0, X_WB * B.p1, B.radius);
  }
  // In A's frame, each support point needs one transform instead of two.
  const Closest cores = closest_cores(A, B, X_WA.inverse() * X_WB);
  return swept(X_WA * cores.p_A, X_WA * cores.p_B, cores.distance, X_WA.rotation * cores.normal, A.radius,
               B.radius);
}

}  // namespace multipanda
