#pragma once

#include <functional>
#include <thread>

namespace multipanda::cli {

// Calls `on_end` once, on a separate thread, when standard input ends. A program that starts a run keeps the
// other end of a pipe: however it ends, even by SIGKILL, the kernel closes the pipe, and the run ends in
// hold. Input is discarded.
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
