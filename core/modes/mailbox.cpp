#include "core/modes/mailbox.hpp"

#include <cstring>

namespace multipanda {

std::uint64_t Mailbox::post(std::span<const Request> requests) {
  const std::lock_guard lock(askers_);
  if (requests.empty() || requests.size() > kMaxBatch) return 0;
  if (ring_.size() + requests.size() > ring_.capacity()) return 0;
  const HostTime now = host_now();
  Posted posted{.received = now};
  for (std::size_t i = 0; i < requests.size(); ++i) {
    posted.request = requests[i];
    posted.request.batch = static_cast<std::uint16_t>(i == 0 ? requests.size() : 1);
    posted.ticket = next_ticket_++;
    ring_.push(posted);
  }
  return posted.ticket;
}

const Mailbox::Posted* Mailbox::front() {
  const Posted* posted = ring_.front();
  if (posted == nullptr || in_batch()) return posted;
  // The first request of a batch has its size. Take none before all have arrived.
  batch_ = posted->request.batch;
  return ring_.size() < batch_ ? nullptr : posted;
}

void Mailbox::pop() {
  ring_.pop();
  if (++taken_of_batch_ == batch_) taken_of_batch_ = 0;
}

// Release on every word: a reader of one of the new words (acquire) also sees the old ticket replaced.
void Mailbox::answer(const Answer& answer) {
  std::array<std::uint64_t, kWords> words{};
  std::memcpy(words.data(), &answer, sizeof(Answer));
  Slot& slot = answers_[answer.ticket % kAnswers];
  slot.ticket.store(0, std::memory_order_relaxed);
  for (std::size_t i = 0; i < kWords; ++i) slot.words[i].store(words[i], std::memory_order_release);
  slot.ticket.store(answer.ticket, std::memory_order_release);
}

bool Mailbox::poll(std::uint64_t ticket, Answer& answer) const {
  const Slot& slot = answers_[ticket % kAnswers];
  if (ticket == 0 || slot.ticket.load(std::memory_order_acquire) != ticket) return false;
  std::array<std::uint64_t, kWords> words{};
  for (std::size_t i = 0; i < kWords; ++i) words[i] = slot.words[i].load(std::memory_order_acquire);
  if (slot.ticket.load(std::memory_order_relaxed) != ticket)
    return false;  // it was overwritten during the read
  std::memcpy(static_cast<void*>(&answer), words.data(), sizeof(Answer));
  return true;
}

}  // namespace multipanda
