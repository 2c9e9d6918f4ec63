#include "core/reference/quintic.hpp"

namespace multipanda {

void QuinticSegment::plan(std::size_t size, const Sample& start, const Values& goal, double duration_s,
                          const Values& end_velocity) {
  size_ = size;
  goal_ = goal;
  duration_ = duration_s > 0 ? duration_s : 0;
  if (duration_ == 0) return;
  const double T = duration_, T2 = T * T, T3 = T2 * T;
  for (std::size_t i = 0; i < size; ++i) {
    const double p0 = start.position[i], v0 = start.velocity[i], a0 = start.acceleration[i];
    const double d = goal[i] - p0, v1 = end_velocity[i];
    // From the six boundary conditions p, v, a at 0 and p = goal, v = end velocity, a = 0 at T.
    coefficients_[i] = {p0,
                        v0,
                        0.5 * a0,
                        (20 * d - (12 * v0 + 8 * v1) * T - 3 * a0 * T2) / (2 * T3),
                        (-30 * d + (16 * v0 + 14 * v1) * T + 3 * a0 * T2) / (2 * T3 * T),
                        (12 * d - 6 * (v0 + v1) * T - a0 * T2) / (2 * T3 * T2)};
  }
}

void QuinticSegment::evaluate(double t, Sample& out) const {
  for (std::size_t i = 0; i < size_; ++i) {
    if (t >= duration_) {
      out.position[i] = goal_[i];
      out.velocity[i] = out.acceleration[i] = 0;
      continue;
    }
    const auto& c = coefficients_[i];
    out.position[i] = c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5]))));
    out.velocity[i] = c[1] + t * (2 * c[2] + t * (3 * c[3] + t * (4 * c[4] + t * 5 * c[5])));
    out.acceleration[i] = 2 * c[2] + t * (6 * c[3] + t * (12 * c[4] + t * 20 * c[5]));
  }
}

}  // namespace multipanda
