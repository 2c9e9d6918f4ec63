#pragma once

#include <array>
#include <atomic>
#include <mutex>
#include <span>

#include "core/modes/request.hpp"
#include "core/rt/spsc_ring.hpp"

namespace multipanda {

// Requests from any thread to the loop, answers back. Askers wait for each other (a mutex the loop never
// touches), the loop waits for nobody: it takes what is there at a cycle boundary.
class Mailbox {
 public:
  // --- any thread but the loop's ---
  // Queues the requests so that the loop takes them in one cycle. The ticket of the last one; 0: no room.
  std::uint64_t post(std::span<const Request> requests);
  // The answer, once the loop has given it. Kept for the last kAnswers tickets.
  bool poll(std::uint64_t ticket, Answer& answer) const;

  // --- loop thread ---
  struct Posted {
    Request request;
    std::uint64_t ticket = 0;
    HostTime received;
  };
  const Posted* front();  // nullptr: nothing, or a batch not yet whole
  void pop() { ring_.pop(); }
  void answer(const Answer& answer);

 private:
  static constexpr std::size_t kQueue = 256, kAnswers = 1024;
  struct Slot {
    std::atomic<std::uint64_t> ticket{0};  // 0 while written
    Answer answer;
  };
  std::mutex askers_;
  std::uint64_t next_ticket_ = 1;  // guarded by askers_
  SpscRing<Posted> ring_{kQueue};
  std::size_t batch_left_ = 0;  // loop
  std::array<Slot, kAnswers> answers_{};
};

}  // namespace multipanda
