#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "core/types/capacity.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

// Quantity of an input. Values of a Target, in this order, in SI units and world axes unless the input
// declares another frame:
//   pose    x y z [m], quaternion w x y z            7
//   twist   vx vy vz [m/s], wx wy wz [rad/s]         6
//   wrench  fx fy fz [N], mx my mz [N m]             6
//   joints  one per joint [rad]                      n
//   scalar  one number                               1
enum class Quantity : std::uint8_t { pose, twist, wrench, joints, scalar };
std::string_view to_string(Quantity quantity);
std::size_t value_count(Quantity quantity, std::size_t joint_count);

// The keys by which scene files and the socket give values of a quantity.
struct QuantityKeys {
  Quantity quantity;
  std::vector<std::string> keys;
  const char* expected;  // in words, with units
};
const std::vector<QuantityKeys>& quantity_keys();  // a row per quantity
const QuantityKeys& keys_of(Quantity quantity);

// For a motion: as above, but the motion of a pose moves its position only.
std::size_t motion_count(Quantity quantity, std::size_t joint_count);

// How a target arrives.
// goal sent once; approached smoothly; remains the target
//   stream  one of a series; silence for longer than the input's timeout is a lost publisher
// motion sent once; a periodic motion from the current set-point (core/reference/harmonic.hpp)
enum class Delivery : std::uint8_t { goal, stream, motion };

// A part of a motion at an integer multiple of its fundamental frequency.
inline constexpr std::size_t kMaxHarmonics = 7;
struct HarmonicPart {
  std::array<double, kMaxTargetValues> sine{}, rise{};  // as for the fundamental
};

// A set-point from a sender. Plain data that is copied between threads.
struct Target {
  std::uint64_t id = 0;  // counts the targets of one input; 0: none yet
  Delivery delivery = Delivery::goal;
  std::uint8_t size = 0;  // values used
  // Time to reach it; longer if the speed limit of the input requires it. 0: as fast as possible.
  double duration_s = 0;
  std::array<double, kMaxTargetValues> values{};  // for a motion: its rise; 3 values (position) for a pose
  // For a motion only
  std::array<double, kMaxTargetValues> sine{};
  double period_s = 0, cycles = 1, ramp_s = 0;
  std::uint8_t harmonic_count = 0;
  // [0] at twice the frequency, [1] at three times, ...
  std::array<HarmonicPart, kMaxHarmonics> harmonics{};

  // Sets size and values; for more numbers than any input takes only the size, which check() refuses.
  void set(std::span<const double> numbers);
  // From the frame of a base to the world: poses are transformed, twists and wrenches rotated.
  void to_world(Quantity quantity, const Pose& X_WB);
};

// Samples of a stream that are not due yet, with the times of the loop at which the set-point shall be there:
// a policy's next actions.
struct Chunk {
  static constexpr std::size_t kMostSamples = 64;
  std::uint64_t id = 0;   // of its first sample, among the targets of the input
  std::uint8_t size = 0;  // values per sample
  std::uint8_t count = 0;
  std::array<double, kMostSamples> times_s{};  // increasing
  std::array<std::array<double, kMaxTargetValues>, kMostSamples> values{};

  Target sample(std::size_t k) const;
};

Target pose_target(const Pose& X, double duration_s = 0, Delivery delivery = Delivery::goal);

}  // namespace multipanda
