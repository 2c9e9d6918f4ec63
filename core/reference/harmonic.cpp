#include "core/reference/harmonic.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace multipanda {
double Harmonic::slope(std::size_t i, double theta) const {
  double slope = sine[i] * std::cos(theta) + 0.5 * rise[i] * std::sin(theta);
  for (std::size_t k = 0; k < harmonic_count; ++k) {
    const double n = static_cast<double>(k + 2), s = std::sin(n * theta), c = std::cos(n * theta);
    slope += n * (harmonics[k].sine[i] * c + 0.5 * harmonics[k].rise[i] * s);
  }
  return slope;
}

double Harmonic::top_speed(std::size_t first, std::size_t count) const {
  if (harmonic_count > 0) return top_speed_of_series(first, count);
  double ss = 0, rr = 0, sr = 0;
  for (std::size_t i = first; i < first + count; ++i) {
    ss += sine[i] * sine[i];
    rr += rise[i] * rise[i] / 4;
    sr += sine[i] * rise[i] / 2;
  }
  const double mean = (ss + rr) / 2, spread = std::hypot((ss - rr) / 2, sr);
  return std::sqrt(mean + spread) * 2 * std::numbers::pi / period_s;
}

// A trigonometric polynomial of degree n is at most 1 / cos(pi n / N) times as large anywhere as at the
// largest of N evenly spaced points, N > 2 n (Ehlich and Zeller 1964). The vector's component in the
// direction of its highest speed is one.
double Harmonic::top_speed_of_series(std::size_t first, std::size_t count) const {
  constexpr std::size_t kPoints = 1024;
  double fastest2 = 0;
  for (std::size_t p = 0; p < kPoints; ++p) {
    const double theta = 2 * std::numbers::pi * static_cast<double>(p) / kPoints;
    double speed2 = 0;
    for (std::size_t i = first; i < first + count; ++i) speed2 += std::pow(slope(i, theta), 2);
    fastest2 = std::max(fastest2, speed2);
  }
  const double degree = static_cast<double>(harmonic_count + 1);
  return std::sqrt(fastest2) / std::cos(std::numbers::pi * degree / kPoints) * 2 * std::numbers::pi /
         period_s;
}

void Harmonic::add(double t, std::size_t size, QuinticSegment::Sample& out) const {
  const double omega = 2 * std::numbers::pi / period_s, T = duration();
  const double from_end = T - t;
  double theta = 0, rate = 0, gain = 0;  // theta and its derivatives
  if (t <= 0) return;
  if (from_end <= 0) {
    theta = omega * period_s * cycles;
  } else if (t < ramp_s) {
    const MinimumJerkStep f = minimum_jerk_step(t / ramp_s);
    theta = omega * ramp_s * f.integral;
    rate = omega * f.value;
    gain = omega * f.slope / ramp_s;
  } else if (from_end < ramp_s) {
    const MinimumJerkStep f = minimum_jerk_step(from_end / ramp_s);
    theta = omega * (period_s * cycles - ramp_s * f.integral);
    rate = omega * f.value;
    gain = -omega * f.slope / ramp_s;
  } else {
    theta = omega * (t - 0.5 * ramp_s);
    rate = omega;
  }
  const auto add_part = [&](double n, const auto& sines, const auto& rises) {
    const double s = std::sin(n * theta), c = std::cos(n * theta);
    for (std::size_t i = 0; i < size; ++i) {
      const double slope = n * (sines[i] * c + 0.5 * rises[i] * s);
      const double bend = n * n * (-sines[i] * s + 0.5 * rises[i] * c);
      out.position[i] += sines[i] * s + 0.5 * rises[i] * (1 - c);
      out.velocity[i] += slope * rate;
      out.acceleration[i] += bend * rate * rate + slope * gain;
    }
  };
  add_part(1, sine, rise);
  for (std::size_t k = 0; k < harmonic_count; ++k) {
    add_part(static_cast<double>(k + 2), harmonics[k].sine, harmonics[k].rise);
  }
}

}  // namespace multipanda
