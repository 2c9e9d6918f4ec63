#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/types/time.hpp"

namespace multipanda::fci {

// How an arm's clock differs from that of the world.
struct ClockOffset {
  double phase_s = 0;    // its states leave so much later than the world's steps; 0 to 1 ms
  double drift_ppm = 0;  // positive: its clock is fast, and it sends more often
};

// When a virtual arm with a clock of its own sends its states. A state that was sent late leaves its program
// at least kLeast for the answer: the clock is set back then, so that stalls of the server are never charged
// to the program.
class ArmClock {
 public:
  static constexpr std::int64_t kLeastNs = 900'000;

  ArmClock(const ClockOffset& offset, HostTime begin)
      : period_ns_(1e6 / (1 + 1e-6 * offset.drift_ppm)), begin_(begin), due_ns_(1e9 * offset.phase_s) {}

  HostTime due() const { return {begin_.ns + static_cast<std::int64_t>(std::llround(due_ns_))}; }
  // The state that was due has been sent.
  void sent(HostTime at) {
    const double earliest = static_cast<double>(at.ns - begin_.ns + kLeastNs), planned = due_ns_ + period_ns_;
    if (earliest > planned) set_back_ns_ += static_cast<std::uint64_t>(earliest - planned);
    due_ns_ = std::max(planned, earliest);
  }
  std::uint64_t set_back_ns() const { return set_back_ns_; }  // in all

 private:
  double period_ns_;
  HostTime begin_;
  double due_ns_;  // after begin_
  std::uint64_t set_back_ns_ = 0;
};

}  // namespace multipanda::fci
