#pragma once

#include <cstdint>
#include <random>

#include "fci/simulated_time/timing.hpp"

namespace multipanda::fci {

// Numbers from a seed, the same on every computer: the standard's distributions may differ between libraries.
class Draw {
 public:
  explicit Draw(std::uint64_t seed) : random_(seed) {}
  // 0 <= x < 1
  double unit() { return static_cast<double>(random_() >> 11) * 0x1.0p-53; }
  bool happens(double share) { return unit() < share; }
  double between(double low, double high) { return low + (high - low) * unit(); }
  // 0 to n - 1
  std::uint64_t below(std::uint64_t n) { return static_cast<std::uint64_t>(unit() * static_cast<double>(n)); }
  std::int64_t time(const DrawnTime& t) {
    return t.least_ns + static_cast<std::int64_t>(unit() * static_cast<double>(t.spread_ns));
  }

 private:
  std::mt19937_64 random_;
};

}  // namespace multipanda::fci
