#include "core/rt/pacer.hpp"

#include <ctime>

namespace multipanda {

void Pacer::start() {
  next_ = host_now();
  overruns_ = 0;
  lateness_ = {};
}

void Pacer::wait() {
  next_ = next_ + period_;
  timespec until{};
  until.tv_sec = next_.ns / 1'000'000'000;
  until.tv_nsec = next_.ns % 1'000'000'000;
  // steady_clock is CLOCK_MONOTONIC on Linux; a signal wakes early, so sleep on.
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) != 0) {
  }
  lateness_ = host_now() - next_;
  if (lateness_ >= period_) {
    const auto missed = lateness_ / period_;
    overruns_ += static_cast<std::uint64_t>(missed);
    next_ = next_ + missed * period_;
  }
}

}  // namespace multipanda
