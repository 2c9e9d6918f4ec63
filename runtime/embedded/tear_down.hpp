#pragma once

#include <functional>
#include <thread>
#include <utility>

namespace multipanda {

// Ends something slow on a thread of its own, so that the loop of a program that shares its thread with other
// hardware loses no period. Off the loops, one thread at a time.
class TearDown {
 public:
  TearDown() = default;
  ~TearDown() { wait(); }
  TearDown(const TearDown&) = delete;

  // Returns at once, unless an earlier one has not ended.
  void start(std::function<void()> work) {
    wait();
    thread_ = std::thread(std::move(work));
  }
  // Until the last one has ended.
  void wait() {
    if (thread_.joinable()) thread_.join();
  }

 private:
  std::thread thread_;
};

}  // namespace multipanda
