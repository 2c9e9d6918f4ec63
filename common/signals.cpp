#include "common/signals.hpp"

#include <cerrno>
#include <optional>
#include <poll.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <sys/signalfd.h>
#include <system_error>
#include <unistd.h>

namespace multipanda {

SignalWatch::SignalWatch(std::function<void(int)> on_first) : on_first_(std::move(on_first)) {
  sigemptyset(&signals_);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&signals_, signal);
  if (const int error = pthread_sigmask(SIG_BLOCK, &signals_, &before_); error != 0) {
    throw std::system_error(error, std::generic_category(), "signals cannot be handled");
  }
  signal_file_ = signalfd(-1, &signals_, SFD_CLOEXEC);
  end_file_ = eventfd(0, EFD_CLOEXEC);
  if (signal_file_ < 0 || end_file_ < 0) {
    throw std::system_error(errno, std::generic_category(), "signals cannot be handled");
  }
  thread_ = std::thread([this] { watch(); });
}

SignalWatch::~SignalWatch() {
  const std::uint64_t one = 1;
  (void)!write(end_file_, &one, sizeof(one));
  thread_.join();
  close(signal_file_);
  close(end_file_);
  pthread_sigmask(SIG_SETMASK, &before_, nullptr);
}

void SignalWatch::watch() {
  using Clock = std::chrono::steady_clock;
  std::optional<Clock::time_point> first;
  for (;;) {
    pollfd files[2] = {{signal_file_, POLLIN, 0}, {end_file_, POLLIN, 0}};
    if (poll(files, 2, -1) < 0 && errno != EINTR) return;
    if ((files[1].revents & POLLIN) != 0) return;
    if ((files[0].revents & POLLIN) == 0) continue;
    signalfd_siginfo info{};
    if (read(signal_file_, &info, sizeof(info)) != static_cast<ssize_t>(sizeof(info))) continue;
    const int signal = static_cast<int>(info.ssi_signo);
    if (first && Clock::now() - *first >= kPatience) _exit(128 + signal);
    if (first) continue;
    first = Clock::now();
    on_first_(signal);
    // Pressed during that, perhaps later than kPatience.
    pollfd waiting{signal_file_, POLLIN, 0};
    while (poll(&waiting, 1, 0) > 0 && read(signal_file_, &info, sizeof(info)) > 0) {
    }
  }
}

}  // namespace multipanda
