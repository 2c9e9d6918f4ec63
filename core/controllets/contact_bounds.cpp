#include "core/controllets/contact_bounds.hpp"

#include <algorithm>
#include <cmath>

namespace multipanda {
namespace {

double share_of(const Vector3& pull, const Vector3& damping, double greatest) {
  const double size = pull.norm();
  if (!(size > 0)) return 0;
  return size / (greatest + std::max(0.0, pull.dot(damping) / size));
}

}  // namespace

ContactBounds tighter(const ContactBounds& a, const ContactBounds& b) {
  return {std::min(a.hand_speed, b.hand_speed), std::min(a.spring_force, b.spring_force),
          std::min(a.spring_moment, b.spring_moment)};
}

BoundedPull bound_pull(const ContactBounds& bounds, const Vector6& pull, const Vector6& damping) {
  return {share_of(pull.head<3>(), damping.head<3>(), bounds.spring_force),
          share_of(pull.tail<3>(), damping.tail<3>(), bounds.spring_moment)};
}

Vector6 BoundedPull::remaining(const Vector6& pull) const {
  Vector6 left = pull;
  if (force_share > 1) left.head<3>() /= force_share;
  if (moment_share > 1) left.tail<3>() /= moment_share;
  return left;
}

double BoundedPull::factor() const { return 1.0 / std::max({1.0, force_share, moment_share}); }

double largest_share(const Vector3& base, const Vector3& extra, double limit) {
  if ((base + extra).squaredNorm() <= limit * limit) return 1;
  const double a = extra.squaredNorm(), b = base.dot(extra);
  const double c = std::min(0.0, base.squaredNorm() - limit * limit);
  return a > 0 ? std::clamp((-b + std::sqrt(b * b - a * c)) / a, 0.0, 1.0) : 1;
}

}  // namespace multipanda
