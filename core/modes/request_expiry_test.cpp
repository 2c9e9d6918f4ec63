#include <thread>

#include <gtest/gtest.h>

#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"
#include "core/types/gap_watch.hpp"

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

// The program was stopped (SIGSTOP) and goes on: nothing moves, and nothing of before is executed.
TEST_F(RequestExpiry, ALoopThatStoodStillStopsItsArms) {
  loop.modes().stop_after_gaps();
  loop.step();
  ASSERT_TRUE(loop.ask(activation("s0")).accepted());
  const std::uint64_t asked = post(activation("s1"), 1000);
  std::this_thread::sleep_for(GapWatch::kLongest + std::chrono::milliseconds(50));
  loop.step();
  Answer answer;
  ASSERT_TRUE(loop.modes().poll(asked, answer));
  EXPECT_EQ(answer.verdict, Verdict::timeout);
  EXPECT_FALSE(runs("s0"));
  EXPECT_FALSE(runs("s1"));
  EXPECT_EQ(loop.modes().stopped(), ArmSet::all(2));
  loop.steps(5);
  EXPECT_FALSE(loop.ask(activation("s0")).accepted()) << "not before somebody resumes";
}

// Its sender did not know of the stop, however late the request comes.
TEST_F(RequestExpiry, WhatWasAskedBeforeAStopDoesNotEndIt) {
  loop.step();
  const HostTime before = host_now();
  loop.modes().stop(ArmSet::of(0));
  loop.step();
  const Request resume{.kind = Kind::resume, .arms = ArmSet::of(0)};
  for (const bool late : {true, false}) {
    std::uint64_t ticket = 0;
    ASSERT_EQ(loop.modes().post(std::span(&resume, 1), ticket, 1, late ? before : host_now()),
              Verdict::accepted);
    loop.step();
    Answer answer;
    ASSERT_TRUE(loop.modes().poll(ticket, answer));
    EXPECT_EQ(answer.verdict, late ? Verdict::arm_stopped : Verdict::accepted);
    EXPECT_EQ(loop.modes().stopped().empty(), !late);
  }
}

TEST(GapWatch, CountsFromTheLastLook) {
  GapWatch watch;
  const HostTime begin{1'000'000'000};
  const auto after = [&](double s) { return HostTime{begin.ns + static_cast<std::int64_t>(1e9 * s)}; };
  EXPECT_EQ(watch.look(begin), HostTime{});
  EXPECT_EQ(watch.look(after(0.4)), HostTime{});
  EXPECT_FALSE(watch.settles());
  EXPECT_EQ(watch.look(after(2)), after(2));
  EXPECT_NEAR(seconds(watch.length()), 1.6, 1e-9);
  for (const double s : {2.1, 2.2}) {
    EXPECT_EQ(watch.look(after(s)), after(2));
    EXPECT_TRUE(watch.settles());
  }
  (void)watch.look(after(2.3));  // long enough, but only the third look: a busy thread
  EXPECT_TRUE(watch.settles());
  (void)watch.look(after(2.4));
  EXPECT_FALSE(watch.settles());
  EXPECT_TRUE(watch.settles(after(2.1))) << "it was read soon after the gap, however long it waits since";
  watch.restart(after(5));
  EXPECT_EQ(watch.look(after(5.1)), after(2));
  // The computer was suspended, and HostTime with it.
  const std::chrono::nanoseconds boot = std::chrono::seconds(7);
  watch.restart(after(6), boot);
  EXPECT_EQ(watch.look(after(6.1), 1, boot + std::chrono::milliseconds(100)), after(2));
  EXPECT_EQ(watch.look(after(6.2), 1, boot + std::chrono::seconds(60)), after(6.2));
  EXPECT_NEAR(seconds(watch.length()), 59.9, 1e-9);
}

}  // namespace
}  // namespace multipanda::request_expiry_test
