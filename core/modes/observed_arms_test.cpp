#include <gtest/gtest.h>

#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"

// Controllets that observe arms which they do not own: what they see, and what happens when those are lost.
namespace multipanda::observed_arms_test {
namespace {

using test::TestLoop;

// Shows the first joint of the arm that it observes, and the age of its state.
class Watch final : public Controllet {
 public:
  static ControlletDescriptor descriptor() {
    return {.type = "watch",
            .doc = "Shows the arm that it observes.",
            .observes = 1,
            .outputs = spec_table<2>(output_at<0>("q_rad", "q"), output_at<1>("age_s", "age"))};
  }
  LawResult start(ControlContext&) override { return LawResult::ok; }
  LawResult update(ControlContext& context) override {
    if (context.observed.size() != 1 || context.observed[0].tau != nullptr) return LawResult::fault;
    *context.arms[0].tau = context.arms[0].terms->c() - 2 * context.arms[0].dq();
    context.outputs[0] = context.observed[0].q()[0];
    context.outputs[1] = context.observed[0].state->age_s;
    return LawResult::ok;
  }
};

Registry registry() {
  Registry registry = test::test_registry();
  registry.add(controllet_type<Watch>());
  return registry;
}

InstanceConfig watch(const std::string& name, ArmIndex own, ArmIndex observed) {
  return {.name = name, .type = "watch", .arms = {own}, .observes = {observed}};
}

struct Observed : testing::Test {
  Observed()
      : loop(3,
             {watch("w01", 0, 1),
              watch("w12", 1, 2),
              watch("w20", 2, 0),
              watch("w10", 1, 0),
              {.name = "s1", .type = "spring", .arms = {1}},
              {.name = "s2", .type = "spring", .arms = {2}}},
             registry(), 64) {
    loop.world.tamper = [this](ArmIndex arm, std::uint64_t, ArmState& state) {
      if (arm == 1) state.mode = leader_mode;
      if (arm == 1 && broken) state.q[0] = std::nan("");
    };
    loop.steps(2);
  }
  bool runs(const char* name) { return (loop.modes().active() & loop.set({name})) != 0; }
  std::uint64_t lost() { return loop.cycle.safety().counted(0, Intervention::observed_arm_lost); }

  ArmMode leader_mode = ArmMode::move;
  bool broken = false;
  TestLoop loop;
};

TEST_F(Observed, AreSeenAndStayWithTheirOwners) {
  ASSERT_TRUE(loop.activate({"w01", "s1"}).accepted());
  loop.world.set_position(1, joint_constant(7, 0.25));
  loop.step();
  EXPECT_EQ(loop.modes().instance(loop.find("w01")).outputs()[0], 0.25);
  EXPECT_EQ(loop.modes().owner(1), loop.find("s1"));
  EXPECT_EQ(loop.modes().owner(0), loop.find("w01"));
  ASSERT_TRUE(loop.ask({.deactivate = loop.set({"s1"})}).accepted());  // the leader goes to its hold
  EXPECT_TRUE(runs("w01"));
  EXPECT_EQ(loop.ownership_fault(), "");
}

TEST_F(Observed, WhoseErrorHoldsTheirFollowersOnly) {
  for (const ArmMode mode :
       {ArmMode::reflex, ArmMode::user_stopped, ArmMode::recovering, ArmMode::other, ArmMode::disconnected}) {
    leader_mode = ArmMode::move;
    loop.steps(2);
    ASSERT_TRUE(loop.activate({"w01", "s1", "s2"}).accepted());
    const std::uint64_t before = lost();
    leader_mode = mode;
    loop.step();
    EXPECT_EQ(loop.modes().owner(0), 0) << static_cast<int>(mode);
    EXPECT_EQ(lost(), before + 1) << static_cast<int>(mode);
    EXPECT_TRUE(runs("s2"));
    EXPECT_EQ(loop.activate({"w01"}).verdict, Verdict::arm_not_ready);
    EXPECT_EQ(loop.modes().owner(0), 0);
  }
}

// A stop of an arm stops what follows it, also through another follower, in the same cycle.
TEST_F(Observed, ThatAreStoppedStopTheirFollowers) {
  ASSERT_TRUE(loop.activate({"w01", "w12", "s2"}).accepted());
  loop.modes().stop(ArmSet::of(2));
  loop.step();
  EXPECT_FALSE(runs("w12"));
  EXPECT_EQ(loop.modes().owner(1), 1);
  EXPECT_TRUE(runs("w01"));  // what it observes is held, and moves no more
  loop.modes().stop(ArmSet::of(1));
  loop.step();
  EXPECT_FALSE(runs("w01"));
  EXPECT_EQ(lost(), 1u);
  EXPECT_EQ(loop.activate({"w01"}).verdict, Verdict::arm_stopped);
  ASSERT_TRUE(loop.ask({.kind = Request::Kind::resume, .arms = ArmSet::of(1)}).accepted());
  loop.steps(10);
  EXPECT_FALSE(runs("w01"));  // it does not go on by itself
  EXPECT_TRUE(loop.activate({"w01"}).accepted());
}

// A start that waits for its own arms waits for the leader, too, though not for minutes: nobody would expect
// it to move. A resume of the leader ends it, as any start that waits.
TEST_F(Observed, AreWaitedForSomeSecondsOnly) {
  enum class Ends { in_time, too_late, resumed };
  for (const Ends ends : {Ends::in_time, Ends::too_late, Ends::resumed}) {
    leader_mode = ArmMode::user_stopped;
    loop.modes().start_when_ready(loop.set({"w01"}));
    for (int k = 0; k < (ends == Ends::too_late ? 5500 : 2000); ++k) {
      loop.modes().set_ready(ArmSet::of(0));
      loop.step();
    }
    if (ends == Ends::resumed) {
      ASSERT_TRUE(loop.ask({.kind = Request::Kind::resume, .arms = ArmSet::of(1)}).accepted());
    }
    EXPECT_FALSE(runs("w01"));
    leader_mode = ArmMode::move;
    loop.steps(10);
    EXPECT_EQ(runs("w01"), ends == Ends::in_time) << static_cast<int>(ends);
    ASSERT_TRUE(loop.ask({.deactivate = loop.set({"w01"})}).accepted());
  }
}

// As a start of a stopped arm: it is canceled, and nothing is refused.
TEST_F(Observed, ThatAreStoppedCancelWhatWaits) {
  loop.modes().stop(ArmSet::of(1));
  loop.step();
  loop.modes().start_when_ready(loop.set({"w01"}));
  loop.modes().set_ready(ArmSet::of(0));
  loop.steps(5500);
  RecordRing& ring = *loop.cycle.record();
  for (const Event* event; (event = ring.events.front()) != nullptr; ring.events.pop())
    EXPECT_NE(event->kind, EventKind::switch_refused);
  EXPECT_FALSE(runs("w01"));
}

TEST_F(Observed, MayBeGuidedByHand) {
  ASSERT_TRUE(loop.activate({"w01"}).accepted());
  leader_mode = ArmMode::guiding;
  loop.steps(50);
  EXPECT_TRUE(runs("w01"));
  ASSERT_TRUE(loop.ask({.deactivate = loop.set({"w01"})}).accepted());
  EXPECT_TRUE(loop.activate({"w01"}).accepted());
}

TEST_F(Observed, WhoseStateIsNotANumberHoldTheirFollowers) {
  ASSERT_TRUE(loop.activate({"w01"}).accepted());
  broken = true;
  loop.step();
  EXPECT_EQ(loop.modes().owner(0), 0);
  EXPECT_EQ(lost(), 1u);
}

// The age of an observed state is that since its packet. 20 ms are bridged, no more.
TEST_F(Observed, WhoseSilenceHoldsTheirFollowersAfter20ms) {
  ASSERT_TRUE(loop.activate({"w01"}).accepted());
  loop.world.due_in_step = [](std::uint64_t) { return ArmSet::of(0) | ArmSet::of(2); };
  for (int k = 1; k <= 19; ++k) {
    loop.step();
    ASSERT_TRUE(runs("w01")) << k;
    ASSERT_NEAR(loop.modes().instance(loop.find("w01")).outputs()[1], 0.001 * k, 1e-9);
  }
  loop.steps(2);  // 21 ms
  EXPECT_FALSE(runs("w01"));
  EXPECT_EQ(loop.modes().owner(0), 0);
  EXPECT_EQ(lost(), 1u);
  loop.world.due_in_step = nullptr;
  loop.steps(10);
  EXPECT_FALSE(runs("w01"));  // it does not go on by itself
}

// Arms that would follow each other, directly or through a third.
TEST_F(Observed, MayNotObserveInACircle) {
  EXPECT_EQ(loop.activate({"w01", "w10"}).verdict, Verdict::observes_itself);
  EXPECT_EQ(loop.activate({"w01", "w12", "w20"}).verdict, Verdict::observes_itself);
  ASSERT_TRUE(loop.activate({"w01", "w12"}).accepted());  // a chain
  EXPECT_EQ(loop.activate({"w20"}).verdict, Verdict::observes_itself);
  EXPECT_EQ(loop.activate({"w10"}).verdict, Verdict::observes_itself);
  EXPECT_TRUE(runs("w01") && runs("w12"));
  Request other{.activate = loop.set({"w10"}), .deactivate = loop.set({"w01"})};
  EXPECT_TRUE(loop.ask(other).accepted());
  EXPECT_TRUE(runs("w10"));
}

TEST(ObservedConfig, RefusesArmsThatItOwnsTwiceOrThatDoNotExist) {
  const auto refusal = [](InstanceConfig config) -> std::string {
    try {
      TestLoop loop(2, {std::move(config)}, registry());
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(refusal(watch("w", 0, 1)), "");
  EXPECT_EQ(refusal(watch("w", 0, 0)), "controllet 'w': it observes an arm that it owns");
  EXPECT_EQ(refusal(watch("w", 0, 7)), "controllet 'w': there is no arm number 7");
  EXPECT_EQ(refusal({.name = "w", .type = "watch", .arms = {0}}),
            "controllet 'w': 'watch' observes 1 arm(s), found 0");
  EXPECT_EQ(refusal({.name = "s", .type = "spring", .arms = {0}, .observes = {1}}),
            "controllet 's': 'spring' observes 0 arm(s), found 1");
}

}  // namespace
}  // namespace multipanda::observed_arms_test
