#include "runtime/embedded/axis_follower.hpp"

#include <algorithm>
#include <cmath>

#include "core/types/time.hpp"

namespace multipanda {
namespace {

// A cascade: position -> velocity -> acceleration -> jerk. Its gains place all poles of the sampled system
//   a += T j,  v += T a,  x += T v
// at exp(-kFollowerBandwidth T).
struct Gains {
  double position = 0, velocity = 0, acceleration = 0;  // [1/s]
};

Gains position_gains() {
  const double m = 1 - std::exp(-kFollowerBandwidth * kArmPeriod);
  // The characteristic polynomial in p = z - 1 is p^3 + T k3 p^2 + T^2 k2 p (1 + p) + T^3 k1 (1 + p)^2.
  const double k1 = m * m * m / (kArmPeriod * kArmPeriod * kArmPeriod);
  const double k2 = (3 * m * m - 2 * m * m * m) / (kArmPeriod * kArmPeriod);
  const double k3 = (3 * m - 3 * m * m + m * m * m) / kArmPeriod;
  return {k1 / k2, k2 / k3, k3};
}

Gains velocity_gains() {
  const double m = 1 - std::exp(-kFollowerBandwidth * kArmPeriod);
  // p^2 + T k2 p + T^2 k1 (1 + p)
  const double k1 = m * m / (kArmPeriod * kArmPeriod), k2 = (2 * m - m * m) / kArmPeriod;
  return {0, k1 / k2, k2};
}

const Gains kPositionGains = position_gains(), kVelocityGains = velocity_gains();

// The rate at which an error is reduced so that it reaches zero with a rate of change of at most `most`:
// linear near zero, a square root beyond.
double braked(double error, double gain, double most) {
  const double size = std::abs(error), linear = most / (gain * gain);
  if (size <= linear) return gain * error;
  return std::copysign(std::sqrt(2 * most * (size - linear / 2)), error);
}

// Towards an end of the range: the largest velocity at the distance d.
double towards_end(const AxisLimits& limits, double d) {
  if (d <= 0) return 0;
  return std::min(limits.velocity,
                  std::sqrt(2 * limits.deceleration * d + limits.offset * limits.offset) - limits.offset);
}

// The largest acceleration towards an end: approaches the velocity `most` and then follows its curve. The
// acceleration changes by at most the largest jerk along the way.
double towards_velocity(const AxisLimits& limits, double most, double v) {
  const double rate = limits.jerk / (limits.acceleration + limits.deceleration);
  const bool braking = most < limits.velocity && v > 0;
  const double slope = braking ? -limits.deceleration * v / (v + limits.offset) : 0;
  return std::min(limits.acceleration, rate * (most - v) + slope);
}

void advance_axis(const AxisLimits& limits, const Gains& gains, double v_d, AxisState& s) {
  const double above = towards_end(limits, limits.upper - s.x),
               below = towards_end(limits, s.x - limits.lower);
  v_d = std::clamp(v_d, -below, above);
  const double a_d = std::clamp(braked(v_d - s.v, gains.velocity, 0.5 * limits.jerk), -limits.acceleration,
                                limits.acceleration);
  const double step = kArmPeriod * limits.jerk;
  double a = s.a + std::clamp(kArmPeriod * gains.acceleration * (a_d - s.a), -step, step);
  a = std::min(a, towards_velocity(limits, above, s.v));
  a = std::max(a, -towards_velocity(limits, below, -s.v));
  // The jerk limit takes precedence: a larger jerk stops the arm at once.
  s.a = std::clamp(a, s.a - step, s.a + step);
  s.v += kArmPeriod * s.a;
  s.x += kArmPeriod * s.v;
}

}  // namespace

double upper_velocity(const AxisLimits& limits, double x) noexcept {
  return towards_end(limits, limits.upper - x);
}
double lower_velocity(const AxisLimits& limits, double x) noexcept {
  return -towards_end(limits, x - limits.lower);
}

void follow_position(const AxisLimits& limits, double x_d, double v_d, AxisState& state) noexcept {
  // Beyond an end, the reference may lead back, but the end alone causes no motion. The velocity of an
  // unreachable reference is ignored.
  const double within = std::clamp(x_d, std::min(limits.lower, state.x), std::max(limits.upper, state.x));
  v_d = within == x_d ? std::clamp(v_d, -limits.velocity, limits.velocity) : 0;
  x_d = within;
  const double error = x_d - kArmPeriod * v_d - state.x;
  const double more = std::clamp(braked(error, kPositionGains.position, 0.5 * limits.acceleration),
                                 -limits.catch_up, limits.catch_up);
  advance_axis(limits, kPositionGains, v_d + more, state);
}

void follow_velocity(const AxisLimits& limits, double v_d, AxisState& state) noexcept {
  advance_axis(limits, kVelocityGains, std::clamp(v_d, -limits.velocity, limits.velocity), state);
}

}  // namespace multipanda
