#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "core/types/capacity.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

// What an input carries. Values of a Target, in this order, SI units, world axes unless the input says
// otherwise:
//   pose    x y z [m], quaternion w x y z            7
//   twist   vx vy vz [m/s], wx wy wz [rad/s]         6
//   wrench  fx fy fz [N], mx my mz [N m]             6
//   joints  one per joint [rad]                      n
//   scalar  one number                               1
enum class Quantity : std::uint8_t { pose, twist, wrench, joints, scalar };
std::string_view to_string(Quantity quantity);
std::size_t value_count(Quantity quantity, std::size_t joint_count);
// Of a motion: as above, but a pose's motion moves its position only.
std::size_t motion_count(Quantity quantity, std::size_t joint_count);

// How a target arrives.
//   goal    sent once; approached smoothly; stays in force
//   stream  one of a series; silence for longer than the input's timeout is a lost publisher
//   motion  sent once; a motion to and fro or round from where the set-point is (core/reference/harmonic.hpp)
enum class Delivery : std::uint8_t { goal, stream, motion };

// A part of a motion that swings a whole number of times as fast as the motion's first part.
inline constexpr std::size_t kMaxOvertones = 7;
struct Overtone {
  std::array<double, kMaxTargetValues> sine{}, rise{};  // as the first part's
};

// One set-point from outside. Plain data, so that it crosses threads by copying.
struct Target {
  std::uint64_t id = 0;  // counts the targets of one input; 0: none yet
  Delivery delivery = Delivery::goal;
  std::uint8_t size = 0;  // values used
  double duration_s =
      0;  // to reach it; longer where the input's speed limit needs it. 0: as fast as that allows
  std::array<double, kMaxTargetValues>
      values{};  // of a motion: its rise; a pose's motion has 3, its position's
  // Of a motion only
  std::array<double, kMaxTargetValues> sine{};
  double period_s = 0, cycles = 1, ramp_s = 0;
  std::uint8_t overtone_count = 0;
  std::array<Overtone, kMaxOvertones> overtones{};  // [0] twice as fast, [1] three times as fast, ...
};

Target pose_target(const Pose& X, double duration_s = 0, Delivery delivery = Delivery::goal);

}  // namespace multipanda
