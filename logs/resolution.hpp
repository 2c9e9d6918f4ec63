#pragma once

#include <cmath>
#include <string_view>

// What logs keep of numbers that follow from others: multiples of a power of two far below what can be
// measured, since the digits behind it took a third of a log. What an arm measures and reports, commands,
// clocks and targets keep every bit, so that a replay repeats the torques of all laws that do not read
// estimated forces.
namespace multipanda {

// About 1e-6: estimated forces, references, the model's poses and speeds, poses that an arm reports, outputs.
inline constexpr double kResolution = 0x1p-20;
// About 2.4e-4 N, N m: torques of the model, outputs.
inline constexpr double kForceResolution = 0x1p-12;
// About 0.93 ns: a time rounded to nanoseconds is as it was.
inline constexpr double kTimingResolution = 0x1p-30;

// The nearest multiple of `resolution`; what is not finite, or too large to have smaller digits, itself.
inline double rounded(double value, double resolution) {
  const double steps = value / resolution;
  return std::abs(steps) < 0x1p52 ? std::rint(steps) * resolution + 0.0 : value;  // + 0: no negative zero
}

// The unit in an output's name says its resolution. Other outputs may be of any size: they become float32.
inline double rounded_output(double value, double resolution) {
  return resolution > 0 ? rounded(value, resolution) : static_cast<double>(static_cast<float>(value));
}
inline double output_resolution(std::string_view name) {
  if (name.find("_per_") != name.npos) return 0;
  if (name.ends_with("_n") || name.ends_with("_nm")) return kForceResolution;
  return name.ends_with("_m") || name.ends_with("_rad") ? kResolution : 0;
}

}  // namespace multipanda
