#pragma once

#include "core/reference/target.hpp"
#include "core/trajectory/quintic.hpp"

namespace multipanda {

// A periodic motion, back and forth or circular, that begins and ends at rest at the current set-point:
//   x(t) = x_0 + sine sin(theta) + rise (1 - cos(theta)) / 2
// + sum over harmonics of the same with 2 theta, 3 theta, ..., theta from 0 to 2 pi cycles
// The rate of theta is 2 pi / period, faded in and out over `ramp` (s(u) = 6u^5 - 15u^4 + 10u^3), so the
// total duration is period * cycles + ramp. A circle of radius r through x_0: rise = -2 r a, sine = r b, with
// a from the center to x_0 and b the initial direction. With harmonics it is a Fourier series per coordinate,
// as used to excite arms for identification (docs/identification.md); it still begins and ends at rest.
struct Harmonic {
  // Minimum ramp, so that velocity and acceleration of the set-point are continuous.
  static constexpr double kShortestRamp = 0.1;  // [s]

  double period_s = 1, cycles = 1, ramp_s = kShortestRamp;  // ramp <= period * cycles
  QuinticSegment::Values sine{}, rise{};                    // per coordinate
  std::size_t harmonic_count = 0;
  std::array<HarmonicPart, kMaxHarmonics> harmonics{};

  double duration() const { return period_s * cycles + ramp_s; }
  // The highest speed of coordinates first to first + count - 1 as a vector: the larger semi-axis of the
  // ellipse times the rate. With harmonics, an upper bound within 0.04 %.
  double top_speed(std::size_t first, std::size_t count) const;
  // Adds the motion of the first `size` coordinates, at time t from its start, to `out`.
  void add(double t, std::size_t size, QuinticSegment::Sample& out) const;

 private:
  double slope(std::size_t i, double theta) const;  // of coordinate i against theta
  double top_speed_of_series(std::size_t first, std::size_t count) const;
};

}  // namespace multipanda
