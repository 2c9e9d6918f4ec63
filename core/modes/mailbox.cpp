#include "core/modes/mailbox.hpp"

namespace multipanda {

std::uint64_t Mailbox::post(std::span<const Request> requests) {
  const std::lock_guard lock(askers_);
  if (requests.empty() || ring_.size() + requests.size() > ring_.capacity()) return 0;
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
  if (posted == nullptr) return nullptr;
  // The first of a batch says how many there are; take none before all have arrived.
  if (batch_left_ == 0) {
    if (ring_.size() < posted->request.batch) return nullptr;
    batch_left_ = posted->request.batch;
  }
  --batch_left_;
  return posted;
}

void Mailbox::answer(const Answer& answer) {
  Slot& slot = answers_[answer.ticket % kAnswers];
  slot.ticket.store(0, std::memory_order_relaxed);
  std::atomic_thread_fence(std::memory_order_release);
  slot.answer = answer;
  slot.ticket.store(answer.ticket, std::memory_order_release);
}

bool Mailbox::poll(std::uint64_t ticket, Answer& answer) const {
  const Slot& slot = answers_[ticket % kAnswers];
  if (slot.ticket.load(std::memory_order_acquire) != ticket) return false;
  answer = slot.answer;
  std::atomic_thread_fence(std::memory_order_acquire);
  return slot.ticket.load(std::memory_order_relaxed) == ticket;  // else overwritten while reading
}

}  // namespace multipanda
