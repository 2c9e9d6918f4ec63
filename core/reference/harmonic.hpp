#pragma once

#include "core/reference/quintic.hpp"
#include "core/reference/target.hpp"

namespace multipanda {

// A motion to and fro or round, that begins and ends at rest where the set-point is:
//   x(t) = x_0 + sine sin(theta) + rise (1 - cos(theta)) / 2
//              + sum over overtones of the same with 2 theta, 3 theta, ...,   theta from 0 to 2 pi cycles
// The rate of theta is 2 pi / period, faded in and out over `ramp` (s(u) = 6u^5 - 15u^4 + 10u^3), so it all
// lasts period * cycles + ramp. A circle of radius r through x_0: rise = -2 r a, sine = r b, with a from the
// centre to x_0 and b the way it begins. With overtones it is a Fourier series per coordinate, as arms are
// excited by for identification (docs/excitation.md); begin and end stay as they are.
struct Harmonic {
  // Fade at least this long: velocity and acceleration of the set-point are continuous.
  static constexpr double kShortestRamp = 0.1;  // [s]

  double period_s = 1, cycles = 1, ramp_s = kShortestRamp;  // ramp <= period * cycles
  QuinticSegment::Values sine{}, rise{};                    // per coordinate
  std::size_t overtone_count = 0;
  std::array<Overtone, kMaxOvertones> overtones{};

  double duration() const { return period_s * cycles + ramp_s; }
  // The highest speed of coordinates first .. first + count - 1 taken as a vector: the ellipse's larger half
  // axis times the rate; with overtones a bound that is at most 0.04 % above it.
  double top_speed(std::size_t first, std::size_t count) const;
  // Adds what the motion makes of the first `size` coordinates at t (from its start) to `out`.
  void add(double t, std::size_t size, QuinticSegment::Sample& out) const;

 private:
  double slope(std::size_t i, double theta) const;  // of coordinate i against theta
  double top_speed_of_series(std::size_t first, std::size_t count) const;
};

}  // namespace multipanda
