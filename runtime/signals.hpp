#pragma once

#include <csignal>
#include <functional>
#include <thread>

namespace multipanda {

// Turns SIGINT, SIGTERM and SIGHUP into calls on a thread of its own, where anything may be done. The first
// one calls `on_first`; the second ends the process at once with 128 + its number, as the shell expects.
//
// Make it before any other thread: threads inherit that they do not take these signals themselves.
class SignalWatch {
 public:
  explicit SignalWatch(std::function<void(int signal)> on_first);  // throws std::system_error
  ~SignalWatch();                                                  // signals act as before
  SignalWatch(const SignalWatch&) = delete;

 private:
  void watch();

  std::function<void(int)> on_first_;
  sigset_t signals_{}, before_{};
  int signal_file_ = -1, end_file_ = -1;
  std::thread thread_;
};

}  // namespace multipanda
