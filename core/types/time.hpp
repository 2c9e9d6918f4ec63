#pragma once

#include <chrono>
#include <cstdint>

// Three clocks that must never be mixed, as three types.
//   RobotTime: counted by one arm since its start; arms' clocks are not synchronized.
//   HostTime:  this computer's steady clock.
//   LoopTime:  since the loop's start: simulated time in lock-step, host time otherwise.
namespace multipanda {

template <typename Clock>
struct TimePoint {
  std::int64_t ns = 0;

  double seconds() const { return static_cast<double>(ns) * 1e-9; }
  static TimePoint from_seconds(double s) {
    return {static_cast<std::int64_t>(s * 1e9 + (s < 0 ? -0.5 : 0.5))};
  }
  friend std::chrono::nanoseconds operator-(TimePoint a, TimePoint b) {
    return std::chrono::nanoseconds(a.ns - b.ns);
  }
  friend TimePoint operator+(TimePoint a, std::chrono::nanoseconds d) { return {a.ns + d.count()}; }
  // NOLINTNEXTLINE(modernize-use-nullptr): a false alarm of clang-tidy 14
  auto operator<=>(const TimePoint&) const = default;
};

using RobotTime = TimePoint<struct RobotClock>;
using HostTime = TimePoint<struct HostClock>;
using LoopTime = TimePoint<struct LoopClock>;

inline HostTime host_now() {
  return {std::chrono::duration_cast<std::chrono::nanoseconds>(
              std::chrono::steady_clock::now().time_since_epoch())
              .count()};
}

// Period of the arm's control interface, on real and on simulated arms.
inline constexpr std::chrono::nanoseconds kArmPeriodNs{1'000'000};
inline constexpr double kArmPeriod = 0.001;  // [s]

inline double seconds(std::chrono::nanoseconds d) { return static_cast<double>(d.count()) * 1e-9; }

}  // namespace multipanda
