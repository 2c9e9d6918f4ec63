#include "core/rt/pacer.hpp"

#include <cerrno>
#include <ctime>

namespace multipanda {

void Pacer::start() { start_at(host_now()); }

void Pacer::start_at(HostTime now) {
  next_ = now;
  overruns_ = 0;
  lateness_ = {};
}

void Pacer::wait() {
  const HostTime release = advance();
  timespec until{};
  until.tv_sec = release.ns / 1'000'000'000;
  until.tv_nsec = release.ns % 1'000'000'000;
  // steady_clock is CLOCK_MONOTONIC on Linux. A signal wakes the thread early, so repeat the sleep.
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
  }
  woke_at(host_now());
}

void Pacer::woke_at(HostTime now) {
  lateness_ = now - next_;
  if (lateness_ >= period_) {
    const auto missed = lateness_ / period_;
    overruns_ += static_cast<std::uint64_t>(missed);
    next_ = next_ + missed * period_;
  }
}

}  // namespace multipanda
