#pragma once

#include <chrono>
#include <cstdint>

#include "core/types/time.hpp"

namespace multipanda {

// The loop's wall clock: releases one cycle per period on an absolute grid, so that delays do not add up. A
// wake-up later than one whole period is an overrun: the missed grid points are counted and skipped. They are
// not caught up in a burst, which would send an arm several torques within one of its cycles.
class Pacer {
 public:
  explicit Pacer(std::chrono::nanoseconds period = std::chrono::milliseconds(1)) : period_(period) {}

  void start();  // loop thread; the first wait() returns one period later
  void wait();   // loop thread; sleeps until the next grid point

  // The arithmetic of the grid, without a clock: start at `now`, the next grid point, a wake-up at `now`.
  void start_at(HostTime now);
  HostTime advance() { return next_ = next_ + period_; }
  void woke_at(HostTime now);

  std::uint64_t overruns() const { return overruns_; }             // grid points missed since start()
  std::chrono::nanoseconds lateness() const { return lateness_; }  // of the last wake-up

 private:
  std::chrono::nanoseconds period_;
  HostTime next_{};
  std::uint64_t overruns_ = 0;
  std::chrono::nanoseconds lateness_{0};
};

}  // namespace multipanda
