#include <functional>

#include <gtest/gtest.h>

#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"

// Starts that wait for their arms, on a world of four: every other decision takes precedence.
namespace multipanda::waiting_start_test {
namespace {

using test::TestLoop;
using Kind = Request::Kind;

std::vector<InstanceConfig> laws() {
  return {{.name = "s0", .type = "spring", .arms = {0}}, {.name = "s2", .type = "spring", .arms = {2}},
          {.name = "s3", .type = "spring", .arms = {3}}, {.name = "p12", .type = "pair", .arms = {1, 2}},
          {.name = "f2", .type = "follow", .arms = {2}}, {.name = "refuser", .type = "refuser", .arms = {1}}};
}

// Switches that were refused since the loop began.
int refusals(TestLoop& loop) {
  int count = 0;
  RecordRing& ring = *loop.cycle.record();
  for (const Event* event; (event = ring.events.front()) != nullptr; ring.events.pop()) {
    count += event->kind == EventKind::switch_refused;
  }
  return count;
}

TEST(WaitingStart, IsExecutedOnceWhenAllItsArmsAreReady) {
  TestLoop loop(4, laws(), test::test_registry());
  loop.step();
  loop.modes().start_when_ready(loop.set({"s0", "p12"}));
  loop.steps(3);
  EXPECT_EQ(loop.modes().owner(0), loop.find("arm0_hold"));
  loop.modes().set_ready(ArmSet::from_bits(0b0011));
  loop.step();
  EXPECT_EQ(loop.modes().active(), loop.set({"s0", "arm1_hold", "arm2_hold", "arm3_hold"}));
  loop.modes().set_ready(ArmSet::all(4));
  loop.step();
  EXPECT_EQ(loop.modes().active(), loop.set({"s0", "p12", "arm3_hold"}));
  EXPECT_EQ(loop.ownership_fault(), "");
  EXPECT_TRUE(loop.ask({.deactivate = loop.set({"s0", "p12"})}).accepted());
  loop.steps(5);
  EXPECT_EQ(loop.modes().owner(1), loop.find("arm1_hold"));
}

TEST(WaitingStart, IsCanceledByAnyOtherDecision) {
  using Act = std::function<void(TestLoop&)>;
  const auto asks = [](Request request) {
    return [request](TestLoop& loop) { EXPECT_TRUE(loop.ask(request).accepted()); };
  };
  TestLoop names(4, laws(), test::test_registry());
  const std::vector<std::pair<const char*, Act>> ends = {
      {"arm2_hold", asks({.activate = names.set({"arm2_hold"})})},
      {"f2", asks({.activate = names.set({"f2"})})},
      {"arm2_hold", asks({.deactivate = names.set({"s2"})})},
      {"arm2_hold", asks({.activate = names.set({"s0"}), .only = true})},
      {"arm2_hold", asks({.kind = Kind::resume, .arms = ArmSet::of(2)})},
      {"arm2_hold", [](TestLoop& loop) { loop.modes().stop(ArmSet::of(2)); }},
      {"arm2_hold", [](TestLoop& loop) { loop.modes().give_up_starts(ArmSet::of(1)); }}};
  for (std::size_t k = 0; k < ends.size(); ++k) {
    for (const bool same_boundary :
         {false, true}) {  // the start could be executed when the other request is taken
      TestLoop loop(4, laws(), test::test_registry());
      loop.step();
      loop.modes().start_when_ready(loop.set({"s3", "p12"}));
      if (same_boundary) loop.modes().set_ready(ArmSet::all(4));
      ends[k].second(loop);
      loop.step();
      loop.modes().set_ready(ArmSet::all(4));
      loop.steps(3);
      EXPECT_EQ(loop.modes().owner(2), loop.find(ends[k].first)) << k << same_boundary;
      EXPECT_NE(loop.modes().owner(1), loop.find("p12")) << k << same_boundary;
      const bool named = k == 3;  // `only` concerns every arm
      EXPECT_EQ(loop.modes().owner(3), loop.find(named ? "arm3_hold" : "s3")) << k << same_boundary;
    }
  }
}

TEST(WaitingStart, TakesAnArmFromItsHoldOnly) {
  TestLoop loop(4, laws(), test::test_registry());
  loop.step();
  ASSERT_TRUE(loop.activate({"f2"}).accepted());
  loop.modes().start_when_ready(loop.set({"p12", "refuser"}));
  loop.modes().set_ready(ArmSet::all(4));
  loop.steps(3);
  EXPECT_EQ(loop.modes().owner(2), loop.find("f2"));
  EXPECT_EQ(loop.modes().owner(1), loop.find("arm1_hold"));  // its own start was refused
  EXPECT_TRUE(loop.ask({.deactivate = loop.set({"f2"})}).accepted());
  loop.steps(3);
  EXPECT_EQ(loop.modes().owner(2), loop.find("arm2_hold"));  // asked for once
}

// Which of its arms was stopped before, when nothing waited: the start is canceled, and nothing is refused.
TEST(WaitingStart, OfAStoppedArmIsCanceledWithoutARefusal) {
  TestLoop loop(4, laws(), test::test_registry(), 64);
  loop.step();
  loop.modes().stop(ArmSet::of(2));
  loop.step();
  loop.modes().start_when_ready(loop.set({"s0", "p12"}));
  loop.modes().set_ready(ArmSet::all(4));
  loop.steps(2);
  EXPECT_EQ(loop.modes().active(), loop.set({"s0", "arm1_hold", "arm2_hold", "arm3_hold"}));
  EXPECT_TRUE(loop.ask({.kind = Kind::resume, .arms = ArmSet::of(2)}).accepted());
  loop.steps(2);
  EXPECT_EQ(loop.modes().active(), loop.set({"s0", "arm1_hold", "arm2_hold", "arm3_hold"}));
  EXPECT_EQ(refusals(loop), 0);
}

TEST(WaitingStart, ArmsThatWereReadyBeforeItDoNotCount) {
  TestLoop loop(4, laws(), test::test_registry());
  loop.step();
  loop.modes().set_ready(ArmSet::all(4));
  loop.modes().start_when_ready(loop.set({"s0"}));
  loop.steps(2);
  EXPECT_EQ(loop.modes().owner(0), loop.find("arm0_hold"));
  loop.modes().set_ready(ArmSet::of(0));
  loop.step();
  EXPECT_EQ(loop.modes().owner(0), loop.find("s0"));
}

TEST(WaitingStart, IsTriedOnceThoughItIsRefused) {
  TestLoop loop(4, laws(), test::test_registry(), 64);
  loop.step();
  loop.modes().start_when_ready(loop.set({"refuser"}));
  loop.modes().set_ready(ArmSet::all(4));
  loop.steps(5);
  EXPECT_EQ(loop.modes().owner(1), loop.find("arm1_hold"));
  EXPECT_EQ(refusals(loop), 1);
}

// Of two that need the same arm the first one gets it, even if it is its hold.
TEST(WaitingStart, OfTwoForTheSameArmTheSecondIsCanceled) {
  for (const char* first : {"arm2_hold", "s2"}) {
    TestLoop loop(4, laws(), test::test_registry(), 64);
    loop.step();
    loop.modes().start_when_ready(loop.set({first, "p12"}));
    loop.modes().set_ready(ArmSet::all(4));
    loop.steps(3);
    EXPECT_EQ(loop.modes().owner(1), loop.find("arm1_hold"));
    EXPECT_EQ(loop.modes().owner(2), loop.find(first));
    EXPECT_EQ(refusals(loop), 0);
  }
}

}  // namespace
}  // namespace multipanda::waiting_start_test
