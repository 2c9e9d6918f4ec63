#pragma once

#include <array>
#include <cstdint>

namespace multipanda {

// What ends a goal before it is reached: the set-point brakes and rests, the law stays active. Infinite:
// nothing. Forces are compared with those at the goal's start, so that the estimate's offset does not count.
struct GoalEnd {
  enum Cause : std::uint8_t { force, moment, distance, count_ };
  static constexpr double kNever = 1e300;
  // Change of the estimated force [N] and moment about K [N m], distance of the hand from where it was [m].
  std::array<double, count_> limits{kNever, kNever, kNever};

  bool set() const { return feels() || limits[distance] < kNever; }
  bool feels() const { return limits[force] < kNever || limits[moment] < kNever; }
};

}  // namespace multipanda
