#include "fci/server/wake.hpp"

#include <algorithm>
#include <cerrno>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/timerfd.h>
#include <system_error>
#include <unistd.h>

namespace multipanda::fci {
namespace {

Socket checked(int file, const char* what) {
  if (file < 0) throw std::system_error(errno, std::system_category(), what);
  return Socket(file);
}

void empty(int file) {
  std::uint64_t count = 0;
  [[maybe_unused]] const auto size = ::read(file, &count, sizeof(count));
}

}  // namespace

WakeTimer::WakeTimer()
    : file_(checked(timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC), "timer")) {}

void WakeTimer::open(Poll& poll) { poll.add(file_.file(), EPOLLIN, *this); }

void WakeTimer::ready(int file, std::uint32_t) {
  empty(file);
  armed_ = false;
}

void WakeTimer::set(HostTime at) {
  at_ = at;
  armed_ = true;
  const std::int64_t ns = std::max<std::int64_t>(at.ns, 1);  // zero would switch it off
  itimerspec spec{};
  spec.it_value.tv_sec = ns / 1'000'000'000;
  spec.it_value.tv_nsec = ns % 1'000'000'000;
  timerfd_settime(file_.file(), TFD_TIMER_ABSTIME, &spec, nullptr);
}

WakeWord::WakeWord() : file_(checked(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC), "event")) {}

void WakeWord::open(Poll& poll) { poll.add(file_.file(), EPOLLIN, *this); }

void WakeWord::ready(int file, std::uint32_t) { empty(file); }

void WakeWord::call() const {
  const std::uint64_t one = 1;
  [[maybe_unused]] const auto size = ::write(file_.file(), &one, sizeof(one));
}

}  // namespace multipanda::fci
