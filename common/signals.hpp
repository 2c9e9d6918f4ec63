#pragma once

#include <chrono>
#include <csignal>
#include <functional>
#include <thread>

namespace multipanda {

// Handles SIGINT, SIGTERM and SIGHUP on a thread of its own, outside of signal handlers. The first signal
// calls `on_first`; one that comes 2 s later or more ends the process at once with the exit code 128 + its
// number. Those in between are ignored: somebody who presses Ctrl-C twice expects the arms to stop, not to
// lose their loop.
//
// Construct it before any other thread: threads inherit the mask that blocks these signals.
class SignalWatch {
 public:
  static constexpr std::chrono::seconds kPatience{2};  // with the first signal

  explicit SignalWatch(std::function<void(int signal)> on_first);  // throws std::system_error
  ~SignalWatch();                                                  // restores the signals
  SignalWatch(const SignalWatch&) = delete;

 private:
  void watch();

  std::function<void(int)> on_first_;
  sigset_t signals_{}, before_{};
  int signal_file_ = -1, end_file_ = -1;
  std::thread thread_;
};

}  // namespace multipanda
