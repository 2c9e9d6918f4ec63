// What a cycle makes of arms that are silent, that lose commands, that return, and of its own pauses.
#include "core/state/arm_condition.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "core/cycle/control_cycle.hpp"
#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"

namespace multipanda::arm_condition_test {
namespace {

using test::TestLoop;
using Kind = Request::Kind;

std::vector<InstanceConfig> laws() {
  return {{.name = "s0", .type = "spring", .arms = {0}},
          {.name = "p12", .type = "pair", .arms = {1, 2}},
          {.name = "f2", .type = "follow", .arms = {2}}};
}

TEST(ArmCondition, FollowsModeAgeAndGaps) {
  ArmCondition arm;
  ArmState state;
  state.mode = ArmMode::move;
  state.fresh = true;
  state.tau_J_d = joint_constant(7, 3);
  arm.update(state, 0.5, 0.02);
  EXPECT_TRUE(arm.usable && arm.returned) << "its first state";
  EXPECT_EQ(arm.gap_s, 0) << "nothing was missed before it";
  EXPECT_EQ(arm.torque_in_use[6], 3);
  state.fresh = false;
  state.tau_J_d = joint_constant(7, 1.5);
  for (int k = 1; k <= 3; ++k) {
    arm.update(state, 0.001, 0.02);
    EXPECT_NEAR(arm.age_s, 0.001 * k, 1e-15);
    EXPECT_TRUE(arm.usable && !arm.returned && arm.gap_s == 0);
    EXPECT_EQ(arm.torque_in_use[6], 3) << "as of its last state";
  }
  state.fresh = true;
  arm.update(state, 0.001, 0.02);
  EXPECT_NEAR(arm.gap_s, 0.004, 1e-15);
  EXPECT_FALSE(arm.returned);
  EXPECT_EQ(arm.age_s, 0);
  arm.update(state, 0.02, 0.02);
  EXPECT_FALSE(arm.returned) << "the longest gap itself";
  arm.update(state, 0.021, 0.02);
  EXPECT_TRUE(arm.returned) << "after too long a gap";
  state.fresh = false;
  state.mode = ArmMode::disconnected;  // reported without a packet
  arm.update(state, 0.001, 0.02);
  EXPECT_FALSE(arm.usable);
  state.fresh = true;
  state.mode = ArmMode::idle;
  arm.update(state, 0.001, 0.02);
  EXPECT_TRUE(arm.usable && arm.returned);
}

// An arm that keeps its own torque: it goes on with an old one where answers are lost. The law's torque rises
// by the whole rate limit. Whatever the length of the gap, the first command that arrives after it is at most
// one step from what the arm has in use.
TEST(TorqueInUse, AfterLostAnswersTheCommandIsOneStepFromWhatTheArmUses) {
  for (int lost = 1; lost <= 19; ++lost) {
    TestLoop loop(1, {{.name = "f", .type = "follow", .arms = {0}}}, test::test_registry(), 100);
    loop.modes().activate_at_start(loop.set({"f"}));
    loop.steps(3);
    // 20 N m/rad: 1.5 rad away, the law asks for 30 N m at once.
    JointVector in_use = loop.world.torque(0);
    const JointVector away = loop.world.position(0) - joint_constant(7, 1.5);
    loop.world.tamper = [&](ArmIndex, std::uint64_t, ArmState& state) {
      state.q = away;
      state.dq.setZero();
      state.tau_J_d = in_use.cast<float>().cast<double>();
    };
    double worst = 0;
    for (int k = 0; k < 25; ++k) {
      loop.step();
      if (k >= 5 && k < 5 + lost) continue;  // the answer does not arrive
      worst = std::max(worst, (loop.world.torque(0) - in_use).lpNorm<Eigen::Infinity>());
      in_use = loop.world.torque(0);
    }
    EXPECT_LE(worst, 1 + 1e-5) << lost << " lost";
    EXPECT_NEAR(in_use[0], 25 - lost, 1e-3) << "one step for each answer that arrived";
    // The log holds what was sent.
    EXPECT_EQ(loop.cycle.data().tau_cmd[0], loop.world.torque(0));
  }
}

// Neither lost nor taken when the gap begins: the arm shows the torque before the last one, takes the last
// one after that state, and then what the loop sends now. From 19 ms on, the arm is held after
// the gap.
TEST(TorqueInUse, AfterAGapTheLastCommandMayOnlyBeLate) {
  for (const double gap : {0.005, 0.019, 0.03, 0.3}) {
    TestLoop loop(1, {{.name = "f", .type = "follow", .arms = {0}}}, test::test_registry(), 100);
    loop.modes().activate_at_start(loop.set({"f"}));
    loop.steps(3);
    const JointVector home = loop.world.position(0);
    JointVector shown;
    loop.world.tamper = [&](ArmIndex, std::uint64_t, ArmState& state) {
      state.q = home - joint_constant(7, 1.5);  // 30 N m are asked for, later none by the hold
      state.dq.setZero();
      if (shown.size() > 0) state.tau_J_d = shown;
    };
    loop.steps(10);
    shown = loop.world.torque(0);
    loop.step();
    const JointVector late = loop.world.torque(0);
    ASSERT_NEAR(late[2] - shown[2], 1, 1e-9);
    loop.world.start_s += gap;
    loop.step();
    for (const JointVector& in_use : {shown, late})
      EXPECT_LE((loop.world.torque(0) - in_use).lpNorm<Eigen::Infinity>(), 1 + 1e-9) << gap;
  }
}

TEST(TorqueInUse, MayBeUnknown) {
  TestLoop loop(1, {{.name = "f", .type = "follow", .arms = {0}}}, test::test_registry());
  loop.modes().activate_at_start(loop.set({"f"}));
  const JointVector away = loop.world.position(0) - joint_constant(7, 1.5);
  loop.world.tamper = [&](ArmIndex, std::uint64_t step, ArmState& state) {
    state.tau_J_d.resize(0);
    if (step > 0) state.q = away;
    state.dq.setZero();
  };
  loop.step();
  for (int k = 1; k <= 25; ++k) {
    loop.step();
    ASSERT_NEAR(loop.world.torque(0)[2], k, 1e-9);
  }
}

TEST(TorqueInUse, WhereEveryCommandArrivesALaggingMotorDoesNotCount) {
  struct Lagging final : Backend {
    explicit Lagging(Backend& arms_) : arms(arms_) {}
    std::size_t arm_count() const override { return arms.arm_count(); }
    Capabilities capabilities(ArmIndex) const override {
      return {.simulated = true, .every_command_arrives = true};
    }
    ArmSet wait() override { return arms.wait(); }
    LoopTime now() const override { return arms.now(); }
    void read(ArmSet due, std::span<ArmState> states) override { arms.read(due, states); }
    void write(ArmSet due, std::span<const ArmCommand> commands) override { arms.write(due, commands); }
    using Backend::request;
    std::future<RequestAnswer> request(ArmIndex, ArmRequest) override { return {}; }
    Backend& arms;
  };
  const auto models = test::test_models(1);
  test::TestWorld world(models);
  Lagging arms(world);
  ControlCycle cycle(test::test_config(models, {{.name = "f", .type = "follow", .arms = {0}}}),
                     test::test_registry(), arms);
  cycle.modes().activate_at_start(bit(cycle.modes().find("f")));
  const JointVector home = world.position(0);
  std::vector<JointVector> sent(3, joint_constant(7, 0));
  bool away = false;
  world.tamper = [&](ArmIndex, std::uint64_t, ArmState& state) {
    state.q = away ? JointVector(home - joint_constant(7, 1.5)) : home;
    state.dq.setZero();
    state.tau_J_d = sent[sent.size() - 3];  // three periods behind
  };
  for (int k = 0; k < 5; ++k) cycle.step(world.wait());
  away = true;
  for (int k = 1; k <= 25; ++k) {
    cycle.step(world.wait());
    sent.push_back(world.torque(0));
    ASSERT_NEAR(world.torque(0)[2], k, 1e-9);
  }
}

// A state that is there again after silence, as a backend reports it: without a packet, by its mode.
TEST(Returning, AnArmThatWasDisconnectedIsHeldWhereItIsFromTheTorqueInUse) {
  TestLoop loop(3, laws(), test::test_registry());
  loop.modes().activate_at_start(loop.set({"s0", "f2"}));
  loop.steps(20);
  loop.world.due_in_step = [](std::uint64_t) { return ArmSet::of(0) | ArmSet::of(1); };
  loop.steps(30);
  EXPECT_EQ(loop.modes().owner(2), loop.find("arm2_hold"));
  const JointVector elsewhere = loop.world.position(2) + joint_constant(7, 0.3);
  loop.world.set_position(2, elsewhere);
  loop.world.set_velocity(2, joint_constant(7, 0));
  loop.world.tamper = [&](ArmIndex arm, std::uint64_t, ArmState& state) {
    if (arm == 2) state.tau_J_d = joint_constant(7, 6);  // it has kept an old torque
  };
  loop.world.due_in_step = nullptr;
  loop.step();
  EXPECT_TRUE(loop.cycle.data().condition[2].returned);
  // Held elsewhere, where the spring is at rest: towards zero from 6 N m, by one step.
  EXPECT_NEAR(loop.world.torque(2)[4], 5, 1e-3);
  loop.world.tamper = nullptr;
  for (int k = 0; k < 1000; ++k) {
    loop.step();
    ASSERT_LT((loop.world.position(2) - elsewhere).norm(), 0.03);
  }
}

// The loop itself stood still for longer than an arm may be silent: all its arms are held where they are now.
TEST(Pause, ALongPauseOfTheLoopIsAHold) {
  TestLoop loop(3, laws(), test::test_registry(), 100);
  loop.modes().activate_at_start(loop.set({"s0", "p12"}));
  loop.steps(20);
  const auto pause = [&](double s) {  // the world goes on from the same step, later
    loop.world.start_s += s;
    loop.step();
  };
  pause(0.018);
  EXPECT_EQ(loop.modes().active(), loop.set({"s0", "p12"}));
  loop.steps(5);
  const JointVector elsewhere = loop.world.position(1) + joint_constant(7, 0.2);
  loop.world.set_position(1, elsewhere);
  pause(0.5);
  EXPECT_EQ(loop.modes().active(), loop.set({"arm0_hold", "arm1_hold", "arm2_hold"}));
  EXPECT_EQ(loop.cycle.safety().counted(0, Intervention::state_old), 1u);
  for (int k = 0; k < 1000; ++k) {
    loop.step();
    ASSERT_LT((loop.world.position(1) - elsewhere).norm(), 0.03);
  }
  pause(0.5);  // a hold, too, begins again
  const JointVector there = loop.world.position(1) + joint_constant(7, 0.2);
  loop.world.set_position(1, there);
  pause(0.5);
  for (int k = 0; k < 1000; ++k) {
    loop.step();
    ASSERT_LT((loop.world.position(1) - there).norm(), 0.03);
  }
  EXPECT_TRUE(loop.activate({"s0"}).accepted());
}

// A motion of 1 s to a goal, and a pause of 15 ms: the set-point goes on from where it was.
TEST(Pause, ReferencesDoNotCatchUpInOneStep) {
  TestLoop loop(3, laws(), test::test_registry());
  loop.modes().activate_at_start(loop.set({"f2"}));
  loop.steps(5);
  Reference& input = loop.modes().instance(loop.find("f2")).inputs()[0];
  Target target;
  target.size = 7;
  const JointVector goal = loop.world.position(2) + joint_constant(7, 0.4);
  std::copy_n(goal.data(), 7, target.values.begin());
  ASSERT_EQ(input.post(target), Verdict::accepted);
  double worst = 0;
  JointVector before = input.joints();
  for (int k = 0; k < 4000; ++k) {
    if (k == 200) loop.world.start_s += 0.015;
    loop.step();
    const double step = (input.joints() - before).lpNorm<Eigen::Infinity>();
    if (k != 200) worst = std::max(worst, step);
    if (k == 200) {
      EXPECT_GT(step, worst);
      EXPECT_LT(step, 5.5 * worst) << "five periods, not sixteen";
    }
    before = input.joints();
  }
  EXPECT_LT((input.joints() - goal).norm(), 1e-9) << "it still arrives";
}

// The second arm's packets come 0.7 ms after the first's: less than half a period before the next of the
// first. The group ticks on the later packet, and the torque of each arm is at most half a period older than
// its state.
TEST(Group, TicksAgainForAStateNewerByMoreThanHalfAPeriod) {
  TestLoop loop(3, laws(), test::test_registry());
  loop.steps(3);
  loop.world.start_s = 1;
  loop.world.step_s = 0.0001;
  const std::uint64_t begun = loop.world.steps();
  const auto phase_of = [begun](std::uint64_t step) { return (step - begun) % 10; };
  loop.world.due_in_step = [&](std::uint64_t step) {
    const auto phase = phase_of(step);
    return phase == 0 ? ArmSet::of(0) | ArmSet::of(1) : phase == 7 ? ArmSet::of(2) : ArmSet{};
  };
  loop.steps(10);
  ASSERT_TRUE(loop.activate({"p12"}).accepted());  // with a packet of arm 1
  JointVector of_tick = loop.cycle.data().tau_controllet[1];
  int ticks = 0;
  double last_tick = loop.cycle.data().tick.t.seconds();
  for (int k = 1; k <= 200; ++k) {
    const std::uint64_t phase = phase_of(loop.world.steps());
    loop.step();
    const CycleData& data = loop.cycle.data();
    const bool ticked = data.tau_controllet[1] != of_tick;  // the law's torque grows with time
    if (ticked) last_tick = data.tick.t.seconds();
    of_tick = data.tau_controllet[1];
    ticks += ticked;
    if (phase == 7) {
      ASSERT_TRUE(ticked) << "arm 2 gets a torque of its newest state, step " << k;
    }
    if (phase == 0 || phase == 7) {
      ASSERT_LE(data.tick.t.seconds() - last_tick, 0.0005 + 1e-9);
    }
  }
  EXPECT_EQ(ticks, 20) << "once per period, as with any phase";
}

// Arms with clocks of their own: their packets may come at any phase, so a state is 2 ms old if one packet is
// lost. In a group, two may be.
TEST(Group, ArmsWithTheirOwnClocksMayMissTwoPackets) {
  struct OwnClocks final : Backend {
    explicit OwnClocks(Backend& arms_) : arms(arms_) {}
    std::size_t arm_count() const override { return arms.arm_count(); }
    Capabilities capabilities(ArmIndex) const override { return {.own_clock = true}; }
    ArmSet wait() override { return arms.wait(); }
    LoopTime now() const override { return arms.now(); }
    void read(ArmSet due, std::span<ArmState> states) override { arms.read(due, states); }
    void write(ArmSet due, std::span<const ArmCommand> commands) override { arms.write(due, commands); }
    using Backend::request;
    std::future<RequestAnswer> request(ArmIndex, ArmRequest) override { return {}; }
    Backend& arms;
  };
  const auto models = test::test_models(2);
  for (const int lost : {1, 2, 4}) {
    test::TestWorld world(models);
    OwnClocks arms(world);
    ControlCycle cycle(test::test_config(models, {{.name = "p", .type = "pair", .arms = {0, 1}}}),
                       test::test_registry(), arms);
    cycle.modes().activate_at_start(bit(cycle.modes().find("p")));
    world.step_s = 0.0001;
    world.due_in_step = [&](std::uint64_t step) {
      const bool is_lost = step / 10 >= 30 && step / 10 < 30u + static_cast<unsigned>(lost);
      if (step == 0) return ArmSet::all(2);  // both must be there to begin
      if (step % 10 == 0) return ArmSet::of(0);
      return step % 10 == 9 && !is_lost ? ArmSet::of(1) : ArmSet{};
    };
    for (int k = 0; k < 600; ++k) cycle.step(world.wait());
    EXPECT_EQ(cycle.modes().owner(1) == cycle.modes().find("p"), lost <= 2) << lost;
  }
}

}  // namespace
}  // namespace multipanda::arm_condition_test
