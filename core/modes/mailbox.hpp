#pragma once

#include <array>
#include <atomic>
#include <mutex>
#include <span>
#include <type_traits>

#include "core/modes/request.hpp"
#include "core/rt/spsc_ring.hpp"

namespace multipanda {

// Passes requests from any thread to the loop, and answers back. Callers wait for each other (on a mutex that
// the loop never locks). The loop never waits: it takes the queued requests at a cycle boundary.
class Mailbox {
 public:
  static constexpr std::size_t kMaxBatch = 64;  // requests of one call

  // --- any thread except the loop's ---
  // Queues the requests so that the loop takes them in one cycle. Their tickets are consecutive; returns the
  // last one. 0: no requests, more than kMaxBatch, or the queue is full.
  std::uint64_t post(std::span<const Request> requests);
  // Returns the answer if the loop has given it. The last kAnswers answers are kept. `answer` is unchanged if
  // the result is false.
  bool poll(std::uint64_t ticket, Answer& answer) const;

  // --- loop thread ---
  struct Posted {
    Request request;
    std::uint64_t ticket = 0;
    HostTime received;
  };
  const Posted* front();                                 // nullptr: empty, or an incomplete batch
  bool in_batch() const { return taken_of_batch_ > 0; }  // part of the front's batch has been taken
  void pop();
  void answer(const Answer& answer);

 private:
  static constexpr std::size_t kQueue = 256, kAnswers = 1024;

  // An answer as atomic words. A reader that reads while the slot is overwritten gets a torn answer, which it
  // detects by the ticket, but there is no data race.
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
