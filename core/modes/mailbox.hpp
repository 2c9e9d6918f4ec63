#pragma once

#include <array>
#include <atomic>
#include <mutex>
#include <span>
#include <type_traits>

#include "core/modes/request.hpp"
#include "core/rt/spsc_ring.hpp"

namespace multipanda {

// Requests from any thread to the loop, answers back. Askers wait for each other (a mutex the loop never
// touches), the loop waits for nobody: it takes what is there at a cycle boundary.
class Mailbox {
 public:
  static constexpr std::size_t kMaxBatch = 64;  // requests of one call

  // --- any thread but the loop's ---
  // Queues the requests so that the loop takes them in one cycle. Their tickets follow each other; returns
  // that of the last one. 0: none given, more than kMaxBatch, or no room.
  std::uint64_t post(std::span<const Request> requests);
  // The answer, once the loop has given it. Kept for the last kAnswers tickets. `answer` is untouched if
  // false.
  bool poll(std::uint64_t ticket, Answer& answer) const;

  // --- loop thread ---
  struct Posted {
    Request request;
    std::uint64_t ticket = 0;
    HostTime received;
  };
  const Posted* front();                                 // nullptr: nothing, or a batch not yet whole
  bool in_batch() const { return taken_of_batch_ > 0; }  // some of the front's batch were taken already
  void pop();
  void answer(const Answer& answer);

 private:
  static constexpr std::size_t kQueue = 256, kAnswers = 1024;

  // An answer as words, each atomic, so that a reader that comes while the slot is overwritten sees a torn
  // answer (and notices by the ticket) but never races.
  static_assert(std::is_trivially_copyable_v<Answer>);
  static constexpr std::size_t kWords = (sizeof(Answer) + 7) / 8;
  struct Slot {
    std::atomic<std::uint64_t> ticket{0};  // 0 while written
    std::array<std::atomic<std::uint64_t>, kWords> words{};
  };

  std::mutex askers_;
  std::uint64_t next_ticket_ = 1;  // guarded by askers_
  SpscRing<Posted> ring_{kQueue};
  std::size_t taken_of_batch_ = 0, batch_ = 0;  // loop
  std::array<Slot, kAnswers> answers_{};
};

}  // namespace multipanda
