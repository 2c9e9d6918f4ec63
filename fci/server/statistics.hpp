#pragma once

#include <atomic>
#include <cstdint>

namespace multipanda::fci {

// A count that one thread writes and any may read.
class Count {
 public:
  void add(std::uint64_t n = 1) {
    value_.store(value_.load(std::memory_order_relaxed) + n, std::memory_order_relaxed);
  }
  void set(std::uint64_t n) { value_.store(n, std::memory_order_relaxed); }
  std::uint64_t get() const { return value_.load(std::memory_order_relaxed); }

 private:
  std::atomic<std::uint64_t> value_{0};
};

// Counts of an arm's control port since its start.
struct PortStatistics {
  std::uint64_t clients = 0,
                refused = 0;  // programs that connected; that were refused because another was connected
  std::uint64_t motions = 0;  // started
  std::uint64_t states_sent = 0;
  std::uint64_t states_lost = 0;        // by injected faults, or because the program's socket was full
  std::uint64_t commands_received = 0;  // as datagrams
  std::uint64_t commands_used = 0;
  std::uint64_t commands_late = 0;    // came after the period of the state that they answer: dropped
  std::uint64_t commands_lost = 0;    // by injected faults
  std::uint64_t commands_missed = 0;  // periods of a motion without a command in time
  std::uint64_t bad_datagrams = 0, bad_requests = 0;
};

}  // namespace multipanda::fci
