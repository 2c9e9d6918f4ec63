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
  // Is it its turn? Records that were dropped in between only delay it.
  bool due(std::uint64_t cycle) {
    if (off() || (begun_ && cycle < last_ + cycles_)) return false;
    // Stays on its grid, unless it fell behind by more than one turn.
    last_ = begun_ && cycle < last_ + 2 * cycles_ ? last_ + cycles_ : cycle;
    begun_ = true;
    return true;
  }
  // "100 Hz", for lists of interfaces.
  std::string words(double period_s) const {
    return off() ? "off" : fmt::format("{:.4g} Hz", 1 / (static_cast<double>(cycles_) * period_s));
  }

 private:
  std::uint64_t cycles_, last_ = 0;
  bool begun_ = false;
};

}  // namespace multipanda::ros
