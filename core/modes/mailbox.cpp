#include "core/modes/mailbox.hpp"

#include <algorithm>
#include <cstring>

namespace multipanda {

namespace {

// Patience of years is endless.
HostTime end_of(HostTime from, double patience_s) {
  constexpr double kEndless = 1e8;
  if (!(patience_s < kEndless)) return {std::numeric_limits<std::int64_t>::max()};
  return {from.ns + static_cast<std::int64_t>(patience_s * 1e9)};
}

}  // namespace

std::uint64_t Mailbox::post(std::span<const Request> requests, double patience_s, HostTime asked) {
  const std::lock_guard lock(callers_);
  if (requests.empty() || requests.size() > kMaxBatch) return 0;
  if (ring_.size() + requests.size() > ring_.capacity()) return 0;
  const HostTime now = host_now();
  Posted posted{.asked = std::min(asked, now), .received = now, .expires = end_of(now, patience_s)};
  const std::uint64_t last = next_ticket_ + requests.size() - 1;
  stages_[last % kStages].store(word(last, waiting), std::memory_order_relaxed);  // published by the ring
  for (std::size_t i = 0; i < requests.size(); ++i) {
    posted.request = requests[i];
    posted.request.batch = static_cast<std::uint16_t>(requests.size());
    posted.ticket = next_ticket_++;
    ring_.push(posted);
  }
  return posted.ticket;
}

bool Mailbox::withdraw(std::uint64_t ticket) {
  std::uint64_t expected = word(ticket, waiting);
  return stages_[ticket % kStages].compare_exchange_strong(expected, word(ticket, gone),
                                                           std::memory_order_acq_rel);
}

const Mailbox::Posted* Mailbox::front() {
  const Posted* posted = ring_.front();
  if (posted == nullptr || in_batch()) return posted;
  // None of a batch before all have arrived.
  batch_ = posted->request.batch;
  return ring_.size() < batch_ ? nullptr : posted;
}

Mailbox::Claim Mailbox::claim(HostTime now) {
  const Posted* posted = ring_.front();
  if (posted == nullptr || in_batch()) return claim_;
  const std::uint64_t last = posted->ticket + batch_ - 1;
  std::uint64_t expected = word(last, waiting);
  const bool ours = stages_[last % kStages].compare_exchange_strong(expected, word(last, decided),
                                                                    std::memory_order_acq_rel);
  claim_ = !ours ? Claim::withdrawn : now > posted->expires ? Claim::expired : Claim::taken;
  return claim_;
}

void Mailbox::pop() {
  ring_.pop();
  if (++taken_of_batch_ == batch_) taken_of_batch_ = 0;
}

void Mailbox::clear() {
  while (ring_.front() != nullptr) ring_.pop();
  taken_of_batch_ = batch_ = 0;
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
  if (slot.ticket.load(std::memory_order_relaxed) != ticket) return false;  // overwritten during the read
  std::memcpy(static_cast<void*>(&answer), words.data(), sizeof(Answer));
  return true;
}

}  // namespace multipanda
