#include "core/reference/harmonic.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace multipanda {
namespace {

// The fade s(u), its slope and its integral, u in [0, 1].
struct Fade {
  double value, slope, integral;
};
Fade fade(double u) {
  const double u2 = u * u, u3 = u2 * u;
  return {u3 * (10 + u * (6 * u - 15)), 30 * u2 * (1 - u) * (1 - u), u3 * u * (2.5 + u * (u - 3))};
}

}  // namespace

double Harmonic::top_speed(std::size_t first, std::size_t count) const {
  double ss = 0, rr = 0, sr = 0;
  for (std::size_t i = first; i < first + count; ++i) {
    ss += sine[i] * sine[i];
    rr += rise[i] * rise[i] / 4;
    sr += sine[i] * rise[i] / 2;
  }
  const double mean = (ss + rr) / 2, spread = std::hypot((ss - rr) / 2, sr);
  return std::sqrt(mean + spread) * 2 * std::numbers::pi / period_s;
}

void Harmonic::add(double t, std::size_t size, QuinticSegment::Sample& out) const {
  const double omega = 2 * std::numbers::pi / period_s, T = duration();
  const double from_end = T - t;
  double theta = 0, rate = 0, gain = 0;  // theta and its derivatives
  if (t <= 0) return;
  if (from_end <= 0) {
    theta = omega * period_s * cycles;
  } else if (t < ramp_s) {
    const Fade f = fade(t / ramp_s);
    theta = omega * ramp_s * f.integral;
    rate = omega * f.value;
    gain = omega * f.slope / ramp_s;
  } else if (from_end < ramp_s) {
    const Fade f = fade(from_end / ramp_s);
    theta = omega * (period_s * cycles - ramp_s * f.integral);
    rate = omega * f.value;
    gain = -omega * f.slope / ramp_s;
  } else {
    theta = omega * (t - 0.5 * ramp_s);
    rate = omega;
  }
  const double s = std::sin(theta), c = std::cos(theta);
  for (std::size_t i = 0; i < size; ++i) {
    const double slope = sine[i] * c + 0.5 * rise[i] * s;
    const double bend = -sine[i] * s + 0.5 * rise[i] * c;
    out.position[i] += sine[i] * s + 0.5 * rise[i] * (1 - c);
    out.velocity[i] += slope * rate;
    out.acceleration[i] += bend * rate * rate + slope * gain;
  }
}

}  // namespace multipanda
