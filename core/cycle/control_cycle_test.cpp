#include "core/cycle/control_cycle.hpp"

#include <gtest/gtest.h>

#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"

// Faults of controllets, features, states and packets, and their records.
namespace multipanda::control_cycle_test {
namespace {

using test::TestLoop;
using Kind = Request::Kind;

std::vector<InstanceConfig> laws() {
  return {{.name = "s0", .type = "spring", .arms = {0}},
          {.name = "s1", .type = "spring", .arms = {1}},
          {.name = "bad", .type = "broken", .arms = {1}},
          {.name = "p12", .type = "pair", .arms = {1, 2}},
          {.name = "f2", .type = "follow", .arms = {2}}};
}

void set_fault(TestLoop& loop, double fault) {
  Request request{.kind = Kind::set_parameter, .instance = loop.find("bad"), .size = 1};
  request.values[0] = fault;
  ASSERT_TRUE(loop.ask(request).accepted());
}

struct Sabotage {
  double fault;
  Intervention rule;
};
class SabotageTest : public testing::TestWithParam<Sabotage> {};

TEST_P(SabotageTest, IsDeactivatedInTheSameCycleAndTheOthersAreUnaffected) {
  TestLoop loop(3, laws(), test::test_registry(), 400), quiet(3, laws(), test::test_registry());
  for (TestLoop* l : {&loop, &quiet}) {
    l->modes().activate_at_start(l->set({"s0", "bad"}));
    l->steps(100);
  }
  set_fault(loop, GetParam().fault);
  quiet.step();
  EXPECT_EQ(loop.modes().owner(1), loop.find("arm1_hold"));
  EXPECT_EQ(loop.modes().active(), loop.set({"s0", "arm1_hold", "arm2_hold"}));
  EXPECT_EQ(loop.cycle.safety().counted(1, GetParam().rule), 1u);
  for (int k = 0; k < 200; ++k) {
    ASSERT_EQ(loop.world.torque(0), quiet.world.torque(0));
    ASSERT_EQ(loop.world.torque(2), quiet.world.torque(2));
    ASSERT_EQ(loop.world.torque(1).size(), 7);
    ASSERT_TRUE(loop.world.torque(1).allFinite());
    loop.step();
    quiet.step();
  }
  EXPECT_LT(loop.world.velocity(1).norm(), 0.05);
  bool told = false;
  RecordRing& record = *loop.cycle.record();
  while (const Event* event = record.events.front()) {
    told = told || (event->kind == EventKind::intervention && event->intervention == GetParam().rule &&
                    event->arm == 1 && event->cycle == 101);
    record.events.pop();
  }
  EXPECT_TRUE(told);
}

INSTANTIATE_TEST_SUITE_P(Faults, SabotageTest,
                         testing::Values(Sabotage{1, Intervention::torque_not_finite},
                                         Sabotage{2, Intervention::torque_not_finite},
                                         Sabotage{3, Intervention::torque_implausible},
                                         Sabotage{4, Intervention::controllet_threw},
                                         Sabotage{5, Intervention::controllet_fault},
                                         Sabotage{6, Intervention::torque_implausible}));

TEST(ControlCycle, AFeatureThatReturnsNanDeactivatesItsControllet) {
  TestLoop loop(3, laws(), test::test_registry());
  loop.modes().activate_at_start(loop.set({"p12"}));
  loop.steps(5);
  Instance& pair = loop.modes().instance(loop.find("p12"));
  std::vector<Request> batch(2);
  batch[0] = {.kind = Kind::set_parameter, .instance = loop.find("p12"), .size = 1};
  batch[0].index = static_cast<std::uint16_t>(pair.find_parameter("push.torque_nm"));
  batch[0].values[0] = 99;
  batch[1] = {.kind = Kind::set_feature, .instance = loop.find("p12"), .on = true};
  batch[1].index = static_cast<std::uint16_t>(pair.find_feature("push"));
  std::uint64_t ticket = 0;
  ASSERT_EQ(loop.modes().post(batch, ticket), Verdict::accepted);
  loop.step();
  EXPECT_EQ(loop.modes().owner(1), loop.find("arm1_hold"));
  EXPECT_EQ(loop.modes().owner(2), loop.find("arm2_hold"));
  EXPECT_TRUE(loop.world.torque(1).allFinite());
  EXPECT_EQ(loop.cycle.data().tau_feature[1].norm(), 0);
}

// A law and a feature that know no torque for their second arm.
class HalfLaw final : public Controllet {
 public:
  static ControlletDescriptor descriptor() { return {.type = "half", .doc = "", .arms = 2}; }
  LawResult start(ControlContext&) override { return LawResult::ok; }
  LawResult update(ControlContext& context) override {
    context.arms[1].tau->setConstant(std::nan(""));
    return LawResult::ok;
  }
};
class HalfFeature final : public Feature {
 public:
  static ControlletDescriptor descriptor() { return {.type = "half", .doc = ""}; }
  LawResult start(ControlContext&) override { return LawResult::ok; }
  LawResult update(ControlContext& context) override {
    context.arms.back().tau->setConstant(std::nan(""));
    return LawResult::ok;
  }
};

TEST(ControlCycle, AFaultIsCountedForTheArmThatHasIt) {
  Registry registry = test::test_registry();
  registry.add(controllet_type<HalfLaw>());
  registry.add(feature_type<HalfFeature>());
  const InstanceConfig law{.name = "law", .type = "half", .arms = {0, 2}};
  const InstanceConfig feature{.name = "feature", .type = "pair", .arms = {0, 2}, .features = {"half"}};
  for (const auto& configs : {std::vector{law, feature}, std::vector{feature, law}}) {
    TestLoop loop(3, configs, registry);
    loop.step();
    std::uint64_t faults = 0;
    for (const char* name : {"law", "feature"}) {
      ASSERT_TRUE(loop.activate({name}).accepted());
      ++faults;
      EXPECT_EQ(loop.modes().owner(0), loop.find("arm0_hold")) << name;
      EXPECT_EQ(loop.modes().owner(2), loop.find("arm2_hold")) << name;
      EXPECT_EQ(loop.cycle.safety().counted(0), 0u) << name;
      EXPECT_EQ(loop.cycle.safety().counted(2, Intervention::torque_not_finite), faults) << name;
    }
  }
}

// A law fails, and in the same cycle its arm moves so fast that its hold asks for more than is plausible.
TEST(ControlCycle, AHoldThatTakesOverAndFailsLeavesTheArmToItsOwnGravityCompensation) {
  const auto models = test::test_models(1);
  test::TestWorld world(models);
  CycleConfig config = test::test_config(models, {{.name = "bad", .type = "broken", .arms = {0}}});
  config.arms[0].safety.implausible_factor = 0.01;
  ControlCycle cycle(config, test::test_registry(), world);
  MultimodeController& modes = cycle.modes();
  const InstanceIndex bad = modes.find("bad");
  modes.activate_at_start(bit(bad));
  cycle.step(world.wait());
  ASSERT_EQ(modes.owner(0), bad);
  Request fault{.kind = Kind::set_parameter, .instance = bad, .size = 1};
  fault.values[0] = 5;
  std::uint64_t ticket = 0;
  ASSERT_EQ(modes.post(std::span(&fault, 1), ticket), Verdict::accepted);
  world.set_velocity(0, joint_constant(7, 1));
  cycle.step(world.wait());
  EXPECT_EQ(modes.owner(0), 0);
  EXPECT_EQ(cycle.safety().counted(0, Intervention::controllet_fault), 1u);
  EXPECT_EQ(cycle.data().tau_controllet[0], joint_constant(7, 0));
  EXPECT_EQ(world.torque(0), joint_constant(7, 0));
  const std::uint64_t before = cycle.safety().counted(0, Intervention::torque_implausible);
  cycle.step(world.wait());
  EXPECT_EQ(cycle.safety().counted(0, Intervention::torque_implausible), before + 1) << "of the hold";
}

// In the very cycle in which a law fails, its arm's hold acts with its features, unless they fail, too.
TEST(ControlCycle, AHoldThatTakesOverActsWithItsFeaturesAtOnce) {
  for (const bool broken : {false, true}) {
    auto configs = laws();
    configs.push_back({.name = "arm1_hold", .type = "hold", .arms = {1}, .features = {"push"}});
    configs.back().parameters = {{"push.torque_nm", {broken ? 99.0 : 4.0}}};
    TestLoop loop(3, configs, test::test_registry());
    loop.modes().activate_at_start(loop.set({"bad"}));
    loop.steps(10);
    set_fault(loop, 5);
    EXPECT_EQ(loop.modes().owner(1), loop.find("arm1_hold"));
    const double first = broken ? 0 : 4.0 / 200;  // of a fade of 0.2 s
    EXPECT_LT((loop.cycle.data().tau_feature[1] - joint_constant(7, first)).norm(), 1e-12) << broken;
    EXPECT_TRUE(loop.world.torque(1).allFinite());
  }
}

// A feature of a hold that knows no torque adds none.
TEST(ControlCycle, AFeatureOfAHoldThatFailsAddsNothing) {
  TestLoop loop(2,
                {{.name = "arm1_hold",
                  .type = "hold",
                  .arms = {1},
                  .features = {"push"},
                  .parameters = {{"push.torque_nm", {99}}}}},
                test::test_registry());
  for (std::uint64_t k = 1; k <= 5; ++k) {
    loop.step();
    EXPECT_EQ(loop.cycle.data().tau_feature[1], joint_constant(7, 0));
    EXPECT_LT(loop.world.torque(1).norm(), 0.01) << "it is at rest";
    EXPECT_EQ(loop.cycle.safety().counted(1, Intervention::torque_not_finite), k);
    EXPECT_EQ(loop.cycle.safety().counted(0), 0u);
  }
}

// The safety stage is told who owns the arm: from where it is held beyond a limit, it may be taken.
TEST(ControlCycle, AnArmHeldBeyondALimitMayBeTakenFromThereButNotFarther) {
  TestLoop loop(1, {{.name = "s0", .type = "spring", .arms = {0}}}, test::test_registry());
  const auto at_rest = [&](double beyond) {
    JointVector q = loop.models[0]->q_home();
    q[0] = loop.models[0]->limits().q_max[0] + beyond;
    loop.world.set_position(0, q);
    loop.world.set_velocity(0, joint_constant(7, 0));
  };
  at_rest(0.1);
  loop.step();
  at_rest(0.1);
  ASSERT_TRUE(loop.activate({"s0"}).accepted());
  EXPECT_EQ(loop.modes().owner(0), loop.find("s0"));
  at_rest(0.119);
  loop.step();
  EXPECT_EQ(loop.modes().owner(0), loop.find("s0"));
  at_rest(0.121);
  loop.step();
  EXPECT_EQ(loop.modes().owner(0), loop.find("arm0_hold"));
}

TEST(ControlCycle, ANanStateLeadsToHoldAtTheNextValidPosition) {
  TestLoop loop(3, laws(), test::test_registry());
  loop.modes().activate_at_start(loop.set({"s0", "s1", "f2"}));
  loop.steps(10);
  bool broken = true;
  loop.world.tamper = [&](ArmIndex arm, std::uint64_t, ArmState& state) {
    if (arm == 1 && broken) state.q[3] = std::nan("");
  };
  loop.step();
  EXPECT_EQ(loop.modes().owner(1), loop.find("arm1_hold"));
  EXPECT_EQ(loop.modes().owner(0), loop.find("s0"));
  EXPECT_EQ(loop.cycle.safety().counted(1, Intervention::state_not_finite), 1u);
  for (int k = 0; k < 20; ++k) {
    ASSERT_TRUE(loop.world.torque(1).allFinite());
    loop.step();
  }
  EXPECT_LT(loop.world.torque(1).norm(), 1e-9);  // without a measurement the arm only compensates gravity
  EXPECT_EQ(loop.activate({"s1"}).verdict, Verdict::arm_not_ready);
  broken = false;
  const JointVector back = loop.world.position(1);
  loop.steps(1500);
  EXPECT_LT((loop.world.position(1) - back).norm(), 0.01);
  loop.world.set_velocity(1, joint_constant(7, 0.3));
  loop.steps(3000);
  EXPECT_LT((loop.world.position(1) - back).norm(), 0.01);  // it does hold
}

TEST(ControlCycle, AStateOfAnotherSizeCountsAsNotFinite) {
  for (const Eigen::Index size : {0, 6, 8}) {
    TestLoop loop(3, laws(), test::test_registry());
    loop.modes().activate_at_start(loop.set({"s0", "s1", "f2"}));
    loop.steps(10);
    loop.world.tamper = [&](ArmIndex arm, std::uint64_t, ArmState& state) {
      if (arm == 1) state.q = JointVector::Constant(size, 0.1);
    };
    loop.steps(20);
    EXPECT_EQ(loop.modes().owner(1), loop.find("arm1_hold"));
    EXPECT_EQ(loop.cycle.safety().counted(1, Intervention::state_not_finite), 1u);
    EXPECT_EQ(loop.world.torque(1).size(), 7);
    EXPECT_LT(loop.world.torque(1).norm(), 1e-9);
    EXPECT_EQ(loop.modes().owner(0), loop.find("s0"));
  }
}

TEST(ControlCycle, AnArmThatLeavesItsModeIsHeldAndRefused) {
  TestLoop loop(3, laws(), test::test_registry());
  loop.modes().activate_at_start(loop.set({"p12"}));
  loop.steps(3);
  loop.world.tamper = [](ArmIndex arm, std::uint64_t, ArmState& state) {
    if (arm == 2) state.mode = ArmMode::reflex;
  };
  loop.step();
  EXPECT_EQ(loop.modes().owner(1), loop.find("arm1_hold"));
  EXPECT_EQ(loop.modes().owner(2), loop.find("arm2_hold"));
  EXPECT_EQ(loop.cycle.safety().counted(2, Intervention::arm_not_ready), 1u);
  EXPECT_EQ(loop.activate({"f2"}).verdict, Verdict::arm_not_ready);
  EXPECT_TRUE(loop.activate({"s1"}).accepted());
}

// After a reflex, and possibly a motion by hand.
TEST(ControlCycle, AnArmThatReturnsIsHeldAtItsPositionAndBeginsAtTheTorqueInUse) {
  TestLoop loop(1, {}, test::test_registry());
  bool away = false;
  double in_use = 0;
  loop.world.tamper = [&](ArmIndex, std::uint64_t, ArmState& state) {
    if (away) state.mode = ArmMode::reflex;
    if (in_use > 0) state.tau_J_d[0] = in_use;
  };
  loop.steps(10);
  away = true;
  loop.steps(10);
  const JointVector elsewhere = loop.world.position(0) + joint_constant(7, 0.2);
  loop.world.set_position(0, elsewhere);
  loop.world.set_velocity(0, joint_constant(7, 0));
  away = false;
  in_use = 5;
  loop.step();
  EXPECT_NEAR(loop.world.torque(0)[0], 4, 1e-9) << "towards 0 by 1000 N m/s x 1 ms";
  in_use = 0;
  for (int k = 0; k < 1000; ++k) {
    loop.step();
    ASSERT_LT((loop.world.position(0) - elsewhere).norm(), 0.02);
  }
}

// Two arms whose packets arrive half a millisecond apart: the group ticks once per period, on its first arm's
// packet; the second gets the same tick's torque on its own.
TEST(ControlCycle, AGroupTicksOncePerPeriodWhenPacketsArriveAtDifferentTimes) {
  TestLoop loop(3, laws(), test::test_registry());
  loop.steps(3);
  loop.world.start_s = 1;
  loop.world.step_s = 0.0005;
  const auto parity = loop.world.steps() % 2;
  loop.world.due_in_step = [parity](std::uint64_t step) {
    return step % 2 == parity ? ArmSet::of(0) | ArmSet::of(1) : ArmSet::of(2);
  };
  loop.step();                                     // arms 0 and 1
  loop.step();                                     // arm 2
  ASSERT_TRUE(loop.activate({"p12"}).accepted());  // in a step of arm 1
  JointVector of_tick = loop.cycle.data().tau_controllet[2];
  for (int k = 0; k < 50; ++k) {
    loop.step();  // arm 2: no new tick, the torque of arm 1's packet
    ASSERT_EQ(loop.cycle.data().tau_controllet[2], of_tick);
    ASSERT_EQ(loop.world.torque(2), of_tick);
    loop.step();  // arm 1: a new tick, so the torque that grows with time has changed
    ASSERT_NE(loop.cycle.data().tau_controllet[2], of_tick);
    of_tick = loop.cycle.data().tau_controllet[2];
    ASSERT_EQ(loop.modes().owner(2), loop.find("p12"));
  }
}

// The torque of a group's features is that of its tick, too, for the arm whose packet comes later.
TEST(ControlCycle, FeaturesOfAGroupTickWithIt) {
  TestLoop loop(2, {{.name = "p10", .type = "pair", .arms = {1, 0}, .features = {"push"}}},
                test::test_registry());
  loop.world.step_s = 0.0005;
  loop.world.due_in_step = [](std::uint64_t step) { return ArmSet::of(step % 2 == 0 ? 1 : 0); };
  loop.steps(4);
  ASSERT_TRUE(loop.activate({"p10"}).accepted());  // in a step of arm 1
  for (int k = 1; k <= 50; ++k) {
    const JointVector of_tick = joint_constant(7, 0.5 * k / 200);
    ASSERT_LT((loop.cycle.data().tau_feature[1] - of_tick).norm(), 1e-12) << k;
    loop.step();  // arm 0
    ASSERT_LT((loop.cycle.data().tau_feature[0] - of_tick).norm(), 1e-12) << k;
    ASSERT_NEAR((loop.world.torque(0) - loop.cycle.data().tau_controllet[0])[0], of_tick[0], 1e-12) << k;
    loop.step();  // arm 1
  }
}

TEST(ControlCycle, LostPacketsHoldOnlyTheGroupAfterTwoMilliseconds) {
  TestLoop loop(3, laws(), test::test_registry());
  loop.modes().activate_at_start(loop.set({"s0", "p12"}));
  loop.steps(10);
  loop.world.due_in_step = [](std::uint64_t) { return ArmSet::of(0) | ArmSet::of(1); };
  loop.steps(2);  // arm 2's state is 2 ms old
  EXPECT_EQ(loop.modes().owner(1), loop.find("p12"));
  loop.step();
  EXPECT_EQ(loop.modes().owner(1), loop.find("arm1_hold"));
  EXPECT_EQ(loop.modes().owner(2), loop.find("arm2_hold"));
  EXPECT_EQ(loop.modes().owner(0), loop.find("s0"));
  EXPECT_EQ(loop.cycle.safety().counted(2, Intervention::state_old), 1u);
  EXPECT_EQ(loop.activate({"f2"}).verdict, Verdict::arm_not_ready);
  loop.world.due_in_step = nullptr;
  loop.step();
  EXPECT_TRUE(loop.activate({"p12"}).accepted());
}

TEST(ControlCycle, AnArmThatItsControlletOwnsAloneMayBeSilentForTwentyMilliseconds) {
  TestLoop loop(3, laws(), test::test_registry());
  loop.modes().activate_at_start(loop.set({"s0", "f2"}));
  loop.steps(10);
  loop.world.due_in_step = [](std::uint64_t) { return ArmSet::of(0) | ArmSet::of(1); };
  loop.steps(19);
  EXPECT_EQ(loop.modes().owner(2), loop.find("f2"));
  loop.steps(2);
  EXPECT_EQ(loop.modes().owner(2), loop.find("arm2_hold"));
  EXPECT_EQ(loop.modes().owner(0), loop.find("s0"));
}

TEST(ControlCycle, ASilentPublisherLeadsToHold) {
  TestLoop loop(3, laws(), test::test_registry());
  loop.modes().activate_at_start(loop.set({"f2"}));
  loop.step();
  Reference& input = loop.modes().instance(loop.find("f2")).inputs()[0];
  Target target;
  target.delivery = Delivery::stream;
  target.size = 7;
  std::copy_n(loop.world.position(2).data(), 7, target.values.begin());
  for (int k = 0; k < 100; ++k) {
    ASSERT_EQ(input.post(target), Verdict::accepted);
    loop.step();
  }
  loop.steps(100);
  EXPECT_EQ(loop.modes().owner(2), loop.find("f2"));
  loop.steps(2);
  EXPECT_EQ(loop.modes().owner(2), loop.find("arm2_hold"));
  EXPECT_EQ(loop.cycle.safety().counted(2, Intervention::reference_stale), 1u);
}

TEST(ControlCycle, TheFirstTorqueHasAWholePeriodOfTheRateLimit) {
  TestLoop loop(1, {}, test::test_registry());
  loop.world.tamper = [](ArmIndex, std::uint64_t step, ArmState& state) {
    if (step == 0) state.tau_J_d[0] = 5;  // what the arm has in use when the loop begins
  };
  loop.step();
  EXPECT_NEAR(loop.world.torque(0)[0], 4,
              1e-12);  // towards the torque of the hold, near 0, by 1000 N m/s x 1 ms
}

// The rate limit counts the time since the arm's last torque, here half a period.
TEST(ControlCycle, LaterTorquesHaveTheTimeSinceTheLastOne) {
  TestLoop loop(1, {}, test::test_registry());
  loop.world.step_s = 0.0005;
  loop.world.tamper = [](ArmIndex, std::uint64_t step, ArmState& state) {
    if (step == 0) state.tau_J_d[0] = 20;
  };
  for (const double expected : {19.0, 18.5, 18.0, 17.5}) {
    loop.step();
    EXPECT_NEAR(loop.world.torque(0)[0], expected, 1e-9);
  }
}

TEST(Record, HoldsWhatWasReadAndSent) {
  TestLoop loop(3, laws(), test::test_registry(), 100);
  loop.modes().activate_at_start(loop.set({"f2"}));
  std::vector<JointVector> q, tau;
  for (int k = 0; k < 50; ++k) {
    q.push_back(loop.world.position(2));
    loop.step();
    tau.push_back(loop.world.torque(2));
  }
  RecordRing& record = *loop.cycle.record();
  EXPECT_EQ(record.ring.size(), 50u);
  for (std::uint64_t k = 0; k < 50; ++k) {
    const CycleRecord& r = *record.ring.front();
    EXPECT_EQ(r.cycle, k + 1);
    EXPECT_EQ(r.t.ns, static_cast<std::int64_t>(k) * 1'000'000);
    ASSERT_EQ(r.arms.size(), 3u);
    EXPECT_EQ(r.arms[2].owner, loop.find("f2"));
    EXPECT_EQ(r.arms[2].sequence, k + 1);
    for (std::size_t i = 0; i < 7; ++i) {
      EXPECT_EQ(r.arms[2].q[i], q[k][static_cast<Eigen::Index>(i)]);
      EXPECT_EQ(r.arms[2].tau_cmd[i], tau[k][static_cast<Eigen::Index>(i)]);
    }
    ASSERT_EQ(r.reference_count, 1u);
    EXPECT_EQ(r.references[0].instance, loop.find("f2"));
    EXPECT_EQ(r.references[0].values[4], q[0][4]);
    EXPECT_GE(r.stages.total, r.stages.controllets);
    record.ring.pop();
  }
  EXPECT_EQ(record.dropped_records, 0u);
}

TEST(Record, LayoutNamesArmsAndInputsOfEveryInstanceAndReferencesTheirSize) {
  TestLoop loop(3, laws(), test::test_registry(), 100);
  loop.modes().activate_at_start(loop.set({"s0", "f2"}));
  const RecordLayout& layout = loop.cycle.layout();
  EXPECT_EQ(layout.max_references, 1u);
  const RecordLayout::Instance &pair = layout.instances[loop.find("p12")],
                               &follow = layout.instances[loop.find("f2")];
  EXPECT_EQ(pair.name, "p12");
  EXPECT_EQ(pair.type, "pair");
  EXPECT_EQ(pair.arms, 0b110u);
  EXPECT_TRUE(pair.inputs.empty());
  EXPECT_EQ(follow.arms, 0b100u);
  ASSERT_EQ(follow.inputs.size(), 1u);
  EXPECT_EQ(follow.inputs[0].name, "joints");
  EXPECT_EQ(follow.inputs[0].quantity, "joints");
  EXPECT_EQ(follow.parameters,
            (std::vector<std::string>{"joint_limits.range_rad", "joint_limits.stiffness_nm_per_rad",
                                      "joint_limits.damping_nms_per_rad", "joint_limits.range_m",
                                      "joint_limits.stiffness_n_per_m", "joint_limits.damping_n_s_per_m",
                                      "push.torque_nm"}));
  EXPECT_EQ(follow.features, (std::vector<std::string>{"joint_limits", "push"}));
  loop.step();
  const CycleRecord& record = *loop.cycle.record()->ring.front();
  ASSERT_EQ(record.reference_count, 1u);
  EXPECT_EQ(record.references[0].instance, loop.find("f2"));
  EXPECT_EQ(record.references[0].input, 0);
  EXPECT_EQ(record.references[0].size, 7);
  EXPECT_FALSE(record.references[0].streaming);
  loop.cycle.record()->ring.pop();
  Target sample{.delivery = Delivery::stream, .size = 7};
  const JointVector home = loop.models[2]->q_home();
  std::copy(home.begin(), home.end(), sample.values.begin());
  ASSERT_EQ(loop.modes().instance(loop.find("f2")).inputs()[0].post(sample), Verdict::accepted);
  loop.step();
  EXPECT_TRUE(loop.cycle.record()->ring.front()->references[0].streaming);
}

TEST(Record, OverflowIsCountedAndTheLoopContinues) {
  TestLoop loop(3, laws(), test::test_registry(), 10), free(3, laws(), test::test_registry());
  for (int k = 0; k < 50; ++k) {
    loop.step();
    free.step();
    ASSERT_EQ(loop.world.torque(1), free.world.torque(1));
  }
  RecordRing& record = *loop.cycle.record();
  EXPECT_EQ(record.ring.size(), 10u);
  EXPECT_EQ(record.dropped_records, 40u);
  EXPECT_EQ(record.ring.front()->cycle, 1u);  // the oldest stay
  for (int k = 0; k < 5000; ++k) loop.modes().stop(ArmSet::of(0)), loop.step();
  EXPECT_GT(record.dropped_events, 0u);
}

TEST(Record, LayoutNamesTheOutputsOfEveryInstance) {
  TestLoop loop(3, laws(), test::test_registry(), 10);
  loop.modes().activate_at_start(loop.set({"s0"}));
  const RecordLayout& layout = loop.cycle.layout();
  ASSERT_EQ(layout.instances.size(), loop.modes().instance_count());
  loop.step();
  const CycleRecord& r = *loop.cycle.record()->ring.front();
  ASSERT_EQ(r.outputs.size(), layout.output_count);
  for (const auto& instance : layout.instances) {
    const bool active = (loop.modes().active() & bit(loop.find(instance.name))) != 0;
    ASSERT_EQ(instance.outputs.size(), 2u);  // of the two features
    for (const auto& output : instance.outputs) EXPECT_EQ(std::isnan(r.outputs[output.offset]), !active);
  }
}

}  // namespace
}  // namespace multipanda::control_cycle_test
