#pragma once

#include <functional>
#include <termios.h>
#include <thread>

namespace multipanda::cli {

// Single keys from the terminal, without Enter, on a thread of its own that waits for nothing else: the stop
// key must not wait for the table to be drawn. Does nothing if the input is not a terminal. Ctrl-C and
// similar keys still raise their signals; the terminal is restored afterwards.
class KeyWatch {
 public:
  explicit KeyWatch(std::function<void(char key)> on_key);
  ~KeyWatch();
  KeyWatch(const KeyWatch&) = delete;

  bool active() const { return thread_.joinable(); }

 private:
  void watch();

  std::function<void(char)> on_key_;
  termios before_{};
  int end_file_ = -1;
  std::thread thread_;
};

}  // namespace multipanda::cli
