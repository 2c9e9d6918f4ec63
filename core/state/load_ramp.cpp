#include "core/state/load_ramp.hpp"

#include <algorithm>
#include <cmath>

namespace multipanda {
namespace {

// Inertia of a point of mass m at r about the flange (parallel axis theorem).
Matrix3 at_point(double m, const Vector3& r) {
  return m * (r.squaredNorm() * Matrix3::Identity() - r * r.transpose());
}

}  // namespace

Load combined(const Load& a, double x, const Load& b, double y) {
  constexpr double kNothing = 1e-5;  // [kg]: single precision of a hand's mass is 3e-8
  Load sum;
  const double mass = x * a.mass + y * b.mass;
  if (std::abs(mass) < kNothing) return sum;
  sum.mass = mass;
  sum.p_FC = (x * a.mass * a.p_FC + y * b.mass * b.p_FC) / mass;
  sum.inertia_C = x * (a.inertia_C + at_point(a.mass, a.p_FC)) +
                  y * (b.inertia_C + at_point(b.mass, b.p_FC)) - at_point(mass, sum.p_FC);
  return sum;
}

void LoadRamp::aim(const Load& load) {
  from_ = now_;
  to_ = load;
  share_ = 0;
}

bool LoadRamp::advance(double dt) {
  if (share_ >= 1) return false;
  share_ = std::min(1.0, share_ + dt / kDuration);
  now_ = share_ < 1 ? combined(from_, 1 - share_, to_, share_) : to_;
  return true;
}

}  // namespace multipanda
