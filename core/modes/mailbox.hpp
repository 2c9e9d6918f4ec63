#pragma once

#include <array>
#include <atomic>
#include <limits>
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
  static constexpr double kForever = std::numeric_limits<double>::infinity();

  // --- any thread except the loop's ---
  // Queues the requests so that the loop takes them in one cycle. After `patience_s` it refuses them. Their
  // tickets are consecutive; returns the last one. 0: no requests, more than kMaxBatch, or the queue is full.
  // `asked`: when they were sent, if before now.
  std::uint64_t post(std::span<const Request> requests, double patience_s = kForever,
                     HostTime asked = host_now());
  // Withdraws the requests of a call; `ticket` is the one that post() returned. true: the loop will never
  // execute any of them. false: it has taken or refused them, and answers at the end of that cycle.
  bool withdraw(std::uint64_t ticket);
  // Returns the answer if the loop has given it. The last kAnswers answers are kept. `answer` is unchanged if
  // the result is false.
  bool poll(std::uint64_t ticket, Answer& answer) const;

  // --- loop thread ---
  struct Posted {
    Request request;
    std::uint64_t ticket = 0;
    HostTime asked, received, expires;
    bool bounded() const { return expires.ns != std::numeric_limits<std::int64_t>::max(); }
  };
  enum class Claim : std::uint8_t {
    taken,     // to be executed
    expired,   // the caller's patience is over: to be refused
    withdrawn  // the caller was told that it is not executed: no answer
  };
  const Posted* front();  // nullptr: empty, or an incomplete batch
  // All requests of the front's batch, unless part of it has been taken.
  std::size_t batch_size() const { return batch_; }
  const Posted& of_batch(std::size_t i) const { return ring_.peek(i); }
  bool in_batch() const { return taken_of_batch_ > 0; }  // part of the front's batch has been taken
  // Decides once for all requests of the front's batch. Either the sender's withdraw() succeeds or this does.
  Claim claim(HostTime now);
  void pop();
  void answer(const Answer& answer);
  void clear();  // forgets what is queued; while no other thread posts

 private:
  static constexpr std::size_t kQueue = 256, kAnswers = 1024;

  // The last ticket of a call and its stage, at index ticket % kStages. More than the queue holds, so that no
  // queued call loses its place.
  static constexpr std::size_t kStages = 2 * kQueue;
  enum Stage : std::uint64_t { waiting, decided, gone };
  static std::uint64_t word(std::uint64_t ticket, Stage stage) { return ticket << 2 | stage; }
  std::array<std::atomic<std::uint64_t>, kStages> stages_{};

  // An answer as atomic words. A reader that reads while the slot is overwritten gets a torn answer, which it
  // detects by the ticket, but there is no data race.
  static_assert(std::is_trivially_copyable_v<Answer>);
  static constexpr std::size_t kWords = (sizeof(Answer) + 7) / 8;
  struct Slot {
    std::atomic<std::uint64_t> ticket{0};  // 0 while written
    std::array<std::atomic<std::uint64_t>, kWords> words{};
  };

  std::mutex callers_;
  std::uint64_t next_ticket_ = 1;  // protected by callers_
  SpscRing<Posted> ring_{kQueue};
  std::size_t taken_of_batch_ = 0, batch_ = 0;  // loop
  Claim claim_ = Claim::taken;                  // loop: decision on the front's batch
  std::array<Slot, kAnswers> answers_{};
};

}  // namespace multipanda
