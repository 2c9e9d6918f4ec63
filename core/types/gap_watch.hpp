#pragma once

#include <algorithm>
#include <ctime>

#include "core/types/time.hpp"

namespace multipanda {

// Detects that the program stalled (SIGSTOP, swapping, a suspended computer), by calls of one thread at least
// every 0.1 s. Requests from before the end of such a gap are not executed: their sender may have given up,
// and a person may have walked up to the arms.
class GapWatch {
 public:
  static constexpr std::chrono::nanoseconds kLongest = std::chrono::milliseconds(500);
  static constexpr std::chrono::nanoseconds kSlice = std::chrono::milliseconds(100);  // between two looks

  // Returns the end of the latest gap; 0: none so far. `counts`: 0 for a further call before the next read.
  // `boot`: a clock that also counts the time in suspend, unlike HostTime.
  HostTime look(HostTime now = host_now(), int counts = 1, std::chrono::nanoseconds boot = since_boot()) {
    looks_ += counts;
    if (const auto length = std::max(now - seen_, boot - boot_); seen_.ns != 0 && length > kLongest) {
      length_ = length;
      end_ = now;
      looks_ = 0;
    }
    seen_ = now;
    boot_ = boot;
    return end_;
  }
  // Begins again: the time since the last call does not count as a gap.
  void restart(HostTime now = host_now(), std::chrono::nanoseconds boot = since_boot()) {
    seen_ = now;
    boot_ = boot;
  }
  // Whether messages read now may be from before the latest gap's end. They wait in sockets, and other
  // threads may still pass them on.
  bool settles() const { return settles(seen_); }
  bool settles(HostTime read) const {  // the same for messages read then
    constexpr std::chrono::nanoseconds kSettle = std::chrono::milliseconds(250);
    constexpr int kLooks = 4;  // a busy thread has read the waiting messages by then
    return end_.ns != 0 && (read - end_ < kSettle || looks_ < kLooks);
  }
  HostTime end() const { return end_; }                        // of the latest gap; 0: none so far
  std::chrono::nanoseconds length() const { return length_; }  // of it

 private:
  static std::chrono::nanoseconds since_boot() {
    timespec now{};
    (void)clock_gettime(CLOCK_BOOTTIME, &now);
    return std::chrono::seconds(now.tv_sec) + std::chrono::nanoseconds(now.tv_nsec);
  }

  HostTime seen_, end_;
  std::chrono::nanoseconds boot_{0}, length_{0};
  int looks_ = 0;
};

// Why a request is refused after a gap.
inline constexpr const char* kStalled =
    "this program stalled until just now, and earlier requests are not executed: look at the arms, then send "
    "them again";

}  // namespace multipanda
