#include "core/modes/mailbox.hpp"

#include <atomic>
#include <cstdlib>
#include <memory>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

namespace multipanda::mailbox_test {
namespace {

TEST(Mailbox, TicketsCountAndBatchesAreBounded) {
  const auto box = std::make_unique<Mailbox>();
  const std::vector<Request> three(3), many(Mailbox::kMaxBatch + 1);
  EXPECT_EQ(box->post(three), 3u);
  EXPECT_EQ(box->post(three), 6u);
  EXPECT_EQ(box->post({}), 0u);
  EXPECT_EQ(box->post(many), 0u);
  const std::vector<Request> full(Mailbox::kMaxBatch);
  int posted = 0;
  while (box->post(full) != 0) ++posted;
  EXPECT_EQ(posted, 3);  // 6 + 3 x 64 of 256; another 64 do not fit, and none of them is queued
  std::size_t left = 0;
  for (; box->front() != nullptr; box->pop()) ++left;
  EXPECT_EQ(left, 6u + 3 * 64);
}

TEST(Mailbox, HoldsAsManyAsItHasPlacesFor) {
  const auto box = std::make_unique<Mailbox>();
  const std::vector<Request> batch(64);
  for (const std::uint64_t last : {64, 128, 192, 256}) EXPECT_EQ(box->post(batch), last);
  EXPECT_EQ(box->post(std::span(batch).first(1)), 0u);
  EXPECT_NE(box->front(), nullptr);
  for (std::size_t k = 0; k < 64; ++k) box->pop();
  EXPECT_EQ(box->post(batch), 320u);
}

TEST(Mailbox, PatienceIsInSecondsFromThePost) {
  for (const bool late : {false, true}) {
    const auto box = std::make_unique<Mailbox>();
    const Request request;
    ASSERT_NE(box->post(std::span(&request, 1), 1.5), 0u);
    const HostTime end{box->front()->received.ns + 1'500'000'000};
    EXPECT_EQ(box->front()->expires, end);
    EXPECT_EQ(box->claim(late ? HostTime{end.ns + 1} : end),
              late ? Mailbox::Claim::expired : Mailbox::Claim::taken);
  }
}

TEST(Mailbox, AnswersAreKeptForTheirTicketOnly) {
  const auto box = std::make_unique<Mailbox>();
  Answer answer, got;
  got.cycle = 5;
  EXPECT_FALSE(box->poll(7, got));
  EXPECT_EQ(got.cycle, 5u);
  answer.ticket = 7;
  answer.cycle = 42;
  answer.step_sent[15] = 1.5;
  box->answer(answer);
  ASSERT_TRUE(box->poll(7, got));
  EXPECT_EQ(got.cycle, 42u);
  EXPECT_EQ(got.step_sent[15], 1.5);
  EXPECT_FALSE(box->poll(7 + 1024, got));
  answer.ticket = 7 + 1024;
  box->answer(answer);
  EXPECT_FALSE(box->poll(7, got));
  EXPECT_FALSE(box->poll(0, got));
}

// Callers post batches; the loop must see each batch complete and in one cycle, and callers must get complete
// answers. One round uses fewer tickets than answers are kept, so that a caller that the scheduler delays
// still finds its answer.
void batches_stay_whole() {
  const auto box = std::make_unique<Mailbox>();
  constexpr int kThreads = 3, kBatches = 100;  // of 3 requests on average
  std::atomic<int> running{kThreads}, wrong{0};
  std::vector<std::thread> askers;
  for (int t = 0; t < kThreads; ++t) {
    askers.emplace_back([&, t] {
      for (int k = 0; k < kBatches; ++k) {
        std::vector<Request> batch(1 + static_cast<std::size_t>(k + t) % 5);
        for (auto& request : batch) request.index = static_cast<std::uint16_t>(t);
        std::uint64_t ticket = 0;
        while ((ticket = box->post(batch)) == 0) std::this_thread::yield();
        Answer answer;
        while (!box->poll(ticket, answer)) std::this_thread::yield();
        if (answer.ticket != ticket || answer.cycle != ticket * 3 ||
            answer.step_sent[7] != static_cast<double>(ticket))
          ++wrong;
      }
      --running;
    });
  }
  std::uint64_t ticket = 0;
  while (running > 0) {
    const Mailbox::Posted* posted = box->front();
    if (posted == nullptr) {
      std::this_thread::yield();
      continue;
    }
    const std::uint16_t batch = posted->request.batch, asker = posted->request.index;
    for (std::uint16_t i = 0; i < batch; ++i) {
      posted = box->front();
      if (posted == nullptr || posted->request.index != asker || posted->ticket != ++ticket ||
          box->in_batch() != (i > 0)) {
        ++wrong;
        break;
      }
      Answer answer;
      answer.ticket = posted->ticket;
      answer.cycle = posted->ticket * 3;
      answer.step_sent.fill(static_cast<double>(posted->ticket));
      box->answer(answer);
      box->pop();
    }
    if (box->in_batch()) ++wrong;
  }
  for (auto& asker : askers) asker.join();
  EXPECT_EQ(wrong, 0);
}

// Every hand-over waits for the scheduler: the whole series runs only on request.
TEST(Mailbox, BatchesStayWholeAmongManyThreads) {
  const int rounds = std::getenv("MULTIPANDA_FULL") != nullptr ? 20 : 2;
  for (int round = 0; round < rounds && !HasFailure(); ++round) batches_stay_whole();
}

// One thread withdraws each call while another takes it: exactly one of them gets it, in any order.
TEST(Mailbox, AWithdrawalAndTheLoopNeverBothSucceed) {
  const auto box = std::make_unique<Mailbox>();
  constexpr int kCalls = 20000;
  std::vector<char> withdrawn(kCalls), taken(kCalls);
  std::thread asker([&] {
    const Request request;
    for (int k = 0; k < kCalls; ++k) {
      std::uint64_t ticket = 0;
      while ((ticket = box->post(std::span(&request, 1))) == 0) std::this_thread::yield();
      for (int spin = 0; spin < k % 64; ++spin) std::atomic_signal_fence(std::memory_order_seq_cst);
      withdrawn[static_cast<std::size_t>(k)] = box->withdraw(ticket) ? 1 : 0;
    }
  });
  for (int k = 0; k < kCalls;) {
    const Mailbox::Posted* front = box->front();
    if (front == nullptr) {
      std::this_thread::yield();
      continue;
    }
    EXPECT_EQ(front->ticket, static_cast<std::uint64_t>(k + 1));
    taken[static_cast<std::size_t>(k++)] = box->claim(host_now()) == Mailbox::Claim::taken ? 1 : 0;
    box->pop();
  }
  asker.join();
  int both = 0, neither = 0;
  for (std::size_t k = 0; k < kCalls; ++k) {
    both += withdrawn[k] != 0 && taken[k] != 0;
    neither += withdrawn[k] == 0 && taken[k] == 0;
  }
  EXPECT_EQ(both, 0);
  EXPECT_EQ(neither, 0);
}

}  // namespace
}  // namespace multipanda::mailbox_test
