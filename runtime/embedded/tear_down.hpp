#pragma once

#include <functional>
#include <thread>
#include <utility>

namespace multipanda {

// Runs slow clean-up on a separate thread, so that the calling loop, which may serve other hardware, loses no
// period. Off the loops, one thread at a time.
class TearDown {
 public:
  TearDown() = default;
  ~TearDown() { wait(); }
  TearDown(const TearDown&) = delete;

  // Returns at once, unless an earlier clean-up is still running.
  void start(std::function<void()> work) {
    wait();
    thread_ = std::thread(std::move(work));
  }
  // Waits for the last clean-up.
  void wait() {
    if (thread_.joinable()) thread_.join();
  }

 private:
  std::thread thread_;
};

}  // namespace multipanda
