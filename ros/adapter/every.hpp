#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>

#include <fmt/format.h>

namespace multipanda::ros {

// Every n-th cycle: a rate [Hz of the loop's time] for something that comes with the records.
class Every {
 public:
  // Rates above that of the loop mean every cycle; 0: never.
  Every(double rate_hz, double period_s)
      : cycles_(rate_hz > 0 ? std::max<std::uint64_t>(
                                  1, static_cast<std::uint64_t>(std::lround(1 / (rate_hz * period_s))))
                            : 0) {}

  bool off() const { return cycles_ == 0; }
  // Is it its turn? At the multiples of n, so that topics of one rate carry the same stamps; at the first
  // record, too. Records that were dropped in between only delay it.
  bool due(std::uint64_t cycle) {
    if (off() || (begun_ && cycle / cycles_ <= turn_)) return false;
    turn_ = cycle / cycles_;
    begun_ = true;
    return true;
  }
  // "100 Hz", for lists of interfaces.
  std::string words(double period_s) const {
    return off() ? "off" : fmt::format("{:.4g} Hz", 1 / (static_cast<double>(cycles_) * period_s));
  }

 private:
  std::uint64_t cycles_, turn_ = 0;
  bool begun_ = false;
};

}  // namespace multipanda::ros
