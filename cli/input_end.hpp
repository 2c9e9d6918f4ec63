#pragma once

#include <functional>
#include <thread>

namespace multipanda::cli {

// Calls `on_end` once, on a thread of its own, when standard input ends. A program that starts a run keeps
// the other end of a pipe: however it ends, also by SIGKILL, the kernel closes the pipe, and the run ends in
// hold. What comes through the pipe is discarded.
//
// Construct it after the SignalWatch, whose mask its thread inherits.
class InputEndWatch {
 public:
  explicit InputEndWatch(std::function<void()> on_end);  // throws std::system_error
  ~InputEndWatch();
  InputEndWatch(const InputEndWatch&) = delete;
  InputEndWatch& operator=(const InputEndWatch&) = delete;

 private:
  void watch();

  std::function<void()> on_end_;
  int end_file_ = -1;
  std::thread thread_;
};

}  // namespace multipanda::cli
