#include <atomic>
#include <memory>
#include <thread>

#include <gtest/gtest.h>

#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"

// Requests end with their asker's patience: whoever was told that a request was not executed stays right.
namespace multipanda::request_expiry_test {
namespace {

using test::TestLoop;
using Kind = Request::Kind;

std::vector<InstanceConfig> laws() {
  return {{.name = "s0", .type = "spring", .arms = {0}}, {.name = "s1", .type = "spring", .arms = {1}}};
}

struct RequestExpiry : testing::Test {
  RequestExpiry() : loop(2, laws(), test::test_registry()) {}
  std::uint64_t post(const Request& request, double patience_s = MultimodeController::kPatience) {
    std::uint64_t ticket = 0;
    EXPECT_EQ(loop.modes().post(std::span(&request, 1), ticket, patience_s), Verdict::accepted);
    return ticket;
  }
  Request activation(const char* name) { return {.activate = loop.set({name})}; }
  bool runs(const char* name) { return (loop.modes().active() & loop.set({name})) != 0; }

  TestLoop loop;
};

// The patience of 0 s is over whenever the loop looks. In the first cycle as in any later one.
TEST_F(RequestExpiry, TheLoopRefusesWhatIsOlderThanItsAskersPatience) {
  for (const bool first : {true, false}) {
    if (!first) loop.steps(2);
    const std::uint64_t late = post(activation("s0"), 0), patient = post(activation("s1"));
    loop.step();
    Answer answer;
    ASSERT_TRUE(loop.modes().poll(late, answer));
    EXPECT_EQ(answer.verdict, Verdict::timeout);
    ASSERT_TRUE(loop.modes().poll(patient, answer));
    EXPECT_EQ(answer.verdict, Verdict::accepted);
    loop.steps(5);
    EXPECT_FALSE(runs("s0"));
    EXPECT_TRUE(runs("s1"));
  }
}

// Nobody runs the loop: ask() gives up, and what it asked for does not happen afterwards.
TEST_F(RequestExpiry, WhatAskGaveUpIsNeverExecuted) {
  for (const bool first : {true, false}) {
    if (!first) loop.steps(2);
    EXPECT_EQ(loop.modes().ask(activation("s0"), 0).verdict, Verdict::timeout);
    loop.steps(5);
    EXPECT_FALSE(runs("s0"));
  }
}

TEST_F(RequestExpiry, AWithdrawnCallIsWithdrawnAsAWhole) {
  loop.step();
  const std::vector<Request> both = {activation("s0"), activation("s1")};
  std::uint64_t ticket = 0;
  ASSERT_EQ(loop.modes().post(both, ticket), Verdict::accepted);
  EXPECT_TRUE(loop.modes().withdraw(ticket));
  EXPECT_FALSE(loop.modes().withdraw(ticket)) << "it is gone";
  const std::uint64_t next = post(activation("s1"));
  loop.step();
  Answer answer;
  EXPECT_FALSE(loop.modes().poll(ticket, answer));
  EXPECT_FALSE(loop.modes().poll(ticket - 1, answer));
  EXPECT_TRUE(loop.modes().poll(next, answer));
  EXPECT_FALSE(runs("s0"));
  EXPECT_TRUE(runs("s1")) << "the request behind it is taken";
  EXPECT_FALSE(loop.modes().withdraw(next)) << "it was taken";
}

// A controller that is hosted begins again: requests that came while it was inactive are refused, what has no
// asker who waits (parameters of its node) is kept.
TEST_F(RequestExpiry, ALoopThatBeginsAnewKeepsOnlyWhatHasNoEnd) {
  loop.step();
  const std::uint64_t asked = post(activation("s0"), 1000), kept = post(activation("s1"), Mailbox::kForever);
  loop.modes().begin_anew();
  loop.step();
  Answer answer;
  ASSERT_TRUE(loop.modes().poll(asked, answer));
  EXPECT_EQ(answer.verdict, Verdict::timeout);
  ASSERT_TRUE(loop.modes().poll(kept, answer));
  EXPECT_EQ(answer.verdict, Verdict::accepted);
  EXPECT_FALSE(runs("s0"));
  EXPECT_TRUE(runs("s1"));
  EXPECT_TRUE(loop.ask(activation("s0")).accepted());
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
}  // namespace multipanda::request_expiry_test
