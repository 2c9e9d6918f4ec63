#include <algorithm>

#include <gtest/gtest.h>

#include "core/testing/four_arms.hpp"
#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"

// Ownership, requests and answers, on a world of four arms.
namespace multipanda::switching_test {
namespace {

using test::Draw;
using test::four_arms;
using test::TestLoop;
using Kind = Request::Kind;

TEST(Switching, ArmsAreHeldFromTheFirstCycleOn) {
  TestLoop loop(4, four_arms(), test::test_registry());
  EXPECT_EQ(loop.modes().owner(3), 3);  // before the first cycle, too
  loop.step();
  EXPECT_EQ(loop.ownership_fault(), "");
  EXPECT_EQ(loop.modes().active(), loop.set({"arm0_hold", "arm1_hold", "arm2_hold", "arm3_hold"}));
}

TEST(Switching, FirstTorqueComesInTheCycleThatTakesTheRequest) {
  TestLoop loop(4, four_arms(), test::test_registry());
  loop.steps(10);
  const Answer answer = loop.activate({"p12"});
  EXPECT_TRUE(answer.accepted());
  EXPECT_EQ(answer.cycle, 11u);
  EXPECT_EQ(answer.plan.start, loop.set({"p12"}));
  EXPECT_EQ(answer.plan.stop, loop.set({"arm1_hold", "arm2_hold"}));
  EXPECT_EQ(answer.plan.keep, loop.set({"arm0_hold", "arm3_hold"}));
  EXPECT_LE(answer.received, answer.taken);
  EXPECT_LT(answer.taken, answer.first_torque);
  // The law's torque of this very cycle: at rest at the start, 0.01 x (1 ms), less what moved since.
  EXPECT_NEAR(loop.cycle.data().tau_controllet[1][0], 1e-5, 1e-4);
  EXPECT_EQ(loop.modes().owner(1), loop.find("p12"));
  EXPECT_EQ(loop.modes().owner(2), loop.find("p12"));
  EXPECT_EQ(loop.ownership_fault(), "");
}

TEST(Switching, StepAtTheHandOverIsBoundedByTheRateLimitAndReported) {
  TestLoop loop(1,
                {{.name = "f", .type = "follow", .arms = {0}}, {.name = "s", .type = "spring", .arms = {0}}},
                test::test_registry());
  loop.step();
  ASSERT_TRUE(loop.activate({"f"}).accepted());
  Request goal{.kind = Kind::set_target, .instance = loop.find("f")};
  goal.target.size = 7;
  goal.target.values.fill(1.0);
  ASSERT_TRUE(loop.ask(goal).accepted());
  loop.steps(800);
  const JointVector before = loop.world.torque(0);
  const Answer answer = loop.activate({"s"});
  const double sent = (loop.world.torque(0) - before).lpNorm<Eigen::Infinity>();
  EXPECT_NEAR(answer.step_sent[0], sent, 1e-12);
  EXPECT_LE(sent, 1.0 + 1e-12);  // 1000 N m/s for 1 ms
  EXPECT_GE(answer.step_requested[0], answer.step_sent[0]);
}

TEST(Switching, TwoOwnersAreRefusedAndNothingChanges) {
  TestLoop loop(4, four_arms(), test::test_registry());
  loop.step();
  loop.activate({"s1"});
  const InstanceSet before = loop.modes().active();
  EXPECT_EQ(loop.activate({"p12", "s3", "s2"}).verdict, Verdict::two_owners);
  EXPECT_EQ(loop.modes().active(), before);
  EXPECT_THROW(loop.modes().activate_at_start(loop.set({"p12", "p31"})), std::invalid_argument);
}

TEST(Switching, ARefusedStartChangesNothing) {
  for (const char* bad : {"refuser", "thrower"}) {
    TestLoop loop(4, four_arms(), test::test_registry());
    loop.step();
    loop.activate({"s0", "s1"});
    loop.steps(5);
    const InstanceSet before = loop.modes().active();
    EXPECT_EQ(loop.activate({bad, "s3"}).verdict, Verdict::start_refused);
    EXPECT_EQ(loop.modes().active(), before);
    EXPECT_EQ(loop.ownership_fault(), "");
  }
}

// In the cycle in which an arm stops taking commands: a law is refused, its hold is not.
TEST(Switching, OnlyAHoldMayStartOnAnArmThatIsNotReady) {
  for (const ArmIndex arm : {0, 1, 2, 3}) {
    const std::string law = "s" + std::to_string(arm);
    for (const bool runs : {true, false}) {
      TestLoop loop(4, four_arms(), test::test_registry());
      loop.step();
      if (runs) (void)loop.activate({law});
      loop.world.tamper = [&](ArmIndex i, std::uint64_t, ArmState& state) {
        if (i == arm) state.mode = ArmMode::reflex;
      };
      const Answer answer = runs ? loop.ask({.deactivate = loop.set({law})}) : loop.activate({law});
      EXPECT_EQ(answer.verdict, runs ? Verdict::accepted : Verdict::arm_not_ready) << law;
      EXPECT_EQ(loop.modes().owner(arm), arm);
    }
  }
}

TEST(Switching, WrongRequestsAreAnsweredWithTheirReason) {
  TestLoop loop(4, four_arms(), test::test_registry());
  loop.step();
  EXPECT_EQ(loop.ask({.activate = InstanceSet{1} << 40}).verdict, Verdict::unknown_instance);
  for (const std::size_t none : {loop.modes().instance_count(), std::size_t{99}}) {
    const auto instance = static_cast<InstanceIndex>(none);
    EXPECT_EQ(loop.ask({.kind = Kind::set_parameter, .instance = instance}).verdict,
              Verdict::unknown_instance);
  }
  EXPECT_EQ(loop.ask({.kind = Kind::set_parameter, .instance = 0, .index = 99}).verdict,
            Verdict::unknown_parameter);
  Request parameter{.kind = Kind::set_parameter, .instance = 0, .index = 1, .size = 2};
  EXPECT_EQ(loop.ask(parameter).verdict, Verdict::wrong_size);
  parameter.size = 1;
  parameter.values[0] = 77;
  EXPECT_EQ(loop.ask(parameter).verdict, Verdict::out_of_bounds);
  parameter.values[0] = std::nan("");
  EXPECT_EQ(loop.ask(parameter).verdict, Verdict::not_finite);
  const std::size_t features = loop.modes().instance(0).feature_count();
  for (const std::size_t none : {features, std::size_t{9}}) {
    const auto index = static_cast<std::uint16_t>(none);
    EXPECT_EQ(loop.ask({.kind = Kind::set_feature, .instance = 0, .index = index}).verdict,
              Verdict::unknown_feature);
  }
  EXPECT_EQ(loop.ask({.kind = Kind::set_target, .instance = 0}).verdict, Verdict::unknown_input);
  Request target{.kind = Kind::set_target, .instance = loop.find("f2")};
  EXPECT_EQ(loop.ask(target).verdict, Verdict::wrong_size);
  target.target.size = 7;
  EXPECT_EQ(loop.ask(target).verdict, Verdict::not_active);
  EXPECT_EQ(loop.ask({.kind = Kind::resume, .arms = ArmSet::of(7)}).verdict, Verdict::unknown_arm);
}

TEST(Switching, StopHoldsUntilResumed) {
  TestLoop loop(4, four_arms(), test::test_registry());
  loop.step();
  loop.activate({"p12", "s0"});
  loop.modes().stop(ArmSet::of(1));
  loop.step();
  // The pair loses its other arm, too; that one is not stopped. arm 0 continues.
  EXPECT_EQ(loop.modes().active(), loop.set({"s0", "arm1_hold", "arm2_hold", "arm3_hold"}));
  EXPECT_EQ(loop.modes().stopped(), ArmSet::of(1));
  EXPECT_EQ(loop.cycle.safety().counted(1, Intervention::stop_requested), 1u);
  EXPECT_EQ(loop.activate({"p12"}).verdict, Verdict::arm_stopped);
  EXPECT_TRUE(loop.activate({"s2"}).accepted());
  EXPECT_TRUE(loop.ask({.kind = Kind::resume, .arms = ArmSet::of(1)}).accepted());
  EXPECT_EQ(loop.modes().owner(1), loop.find("arm1_hold"));  // a resume starts nothing by itself
  EXPECT_TRUE(loop.activate({"p12"}).accepted());
  loop.modes().stop(ArmSet::all(4));
  loop.step();
  EXPECT_EQ(loop.modes().stopped(), ArmSet::all(4));
  EXPECT_EQ(loop.modes().active(), loop.set({"arm0_hold", "arm1_hold", "arm2_hold", "arm3_hold"}));
  // Resuming one arm says nothing of the others.
  EXPECT_TRUE(loop.ask({.kind = Kind::resume, .arms = ArmSet::of(2)}).accepted());
  EXPECT_EQ(loop.modes().stopped(), ArmSet::from_bits(0b1011));
  EXPECT_EQ(loop.activate({"s0"}).verdict, Verdict::arm_stopped);
  EXPECT_TRUE(loop.activate({"s2"}).accepted());
}

TEST(Switching, FeaturesSwitchAtTheCycle) {
  TestLoop loop(4, four_arms(), test::test_registry());
  loop.step();
  loop.activate({"p12"});
  const Instance& pair = loop.modes().instance(loop.find("p12"));
  const auto push = static_cast<std::uint16_t>(pair.find_feature("push"));
  Request on{.kind = Kind::set_feature, .instance = loop.find("p12"), .index = push, .on = true};
  EXPECT_EQ(loop.cycle.data().tau_feature[1].norm(), 0);
  EXPECT_TRUE(loop.ask(on).accepted());
  EXPECT_TRUE(pair.feature_on(push));
  // 0.5 N m, approached within 0.2 s.
  for (int cycle = 1; cycle <= 250; ++cycle) {
    for (const ArmIndex arm : {ArmIndex{1}, ArmIndex{2}}) {
      const JointVector& tau = loop.cycle.data().tau_feature[arm];
      ASSERT_LT((tau - joint_constant(7, 0.5 * std::min(1.0, cycle / 200.0))).norm(), 1e-12) << cycle;
    }
    loop.step();
  }
  EXPECT_EQ(loop.cycle.data().tau_feature[1], joint_constant(7, 0.5));
  EXPECT_EQ(loop.cycle.data().tau_feature[3].norm(), 0);
  const auto fades = [&](bool to, int cycles, double from) {
    on.on = to;
    EXPECT_TRUE(loop.ask(on).accepted());
    for (int cycle = 1; cycle <= cycles; ++cycle) {
      const double share = std::clamp(from + (to ? cycle : -cycle) / 200.0, 0.0, 1.0);
      ASSERT_NEAR(loop.cycle.data().tau_feature[1][0], 0.5 * share, 1e-12) << to << " " << cycle;
      loop.step();
    }
  };
  fades(false, 210, 1);
  fades(true, 100, 0);
  fades(false, 50, 0.505);  // the loop made a step after the last check
}

// Else its torque would step: it still acts.
TEST(Switching, AFeatureThatStillFadesAndIsSwitchedOnAgainApproachesItsParameters) {
  TestLoop loop(1, {{.name = "s0", .type = "spring", .arms = {0}}}, test::test_registry());
  ASSERT_TRUE(loop.activate({"s0"}).accepted());
  Request on{.kind = Kind::set_feature, .instance = loop.find("s0"), .on = true};
  on.index = static_cast<std::uint16_t>(loop.modes().instance(on.instance).find_feature("push"));
  ASSERT_TRUE(loop.ask(on).accepted());
  loop.steps(300);
  const JointVector before = loop.cycle.data().tau_feature[0];
  EXPECT_EQ(before[0], 0.5);
  Request off = on, value{.kind = Kind::set_parameter, .instance = on.instance, .size = 1, .values = {-0.5}};
  off.on = false;
  value.index =
      static_cast<std::uint16_t>(loop.modes().instance(on.instance).find_parameter("push.torque_nm"));
  for (const Request& request : {value, off, on}) ASSERT_TRUE(loop.ask(request).accepted());
  EXPECT_LT((loop.cycle.data().tau_feature[0] - before).lpNorm<Eigen::Infinity>(), 3 * 1.01 / 200);
  loop.steps(300);
  EXPECT_EQ(loop.cycle.data().tau_feature[0][0], -0.5);
}

// The features of a controllet that starts fade in, each time and whoever owned the arms before.
TEST(Switching, FeaturesFadeInWithTheirControllet) {
  auto configs = four_arms();
  for (auto& config : configs) config.features = {"push"};
  TestLoop loop(4, configs, test::test_registry());
  loop.step();
  for (const char* name : {"p12", "s1", "p31", "p12"}) {
    ASSERT_TRUE(loop.activate({name}).accepted());
    double last = 0;
    for (int cycle = 1; cycle <= 210; ++cycle) {
      const JointVector& tau = loop.cycle.data().tau_feature[1];
      ASSERT_NEAR(tau[0], 0.5 * std::min(1.0, cycle / 200.0), 1e-12) << name << " " << cycle;
      ASSERT_LE(tau[0] - last, 0.5 / 200 + 1e-12);
      last = tau[0];
      loop.step();
    }
    EXPECT_EQ(loop.cycle.data().tau_feature[1], joint_constant(7, 0.5)) << name;
  }
}

// Every feature on every controllet, on and off while running: taken at the next cycle, and its torque begins
// or ends in that same cycle. The arms are where features act: near a limit, moving, below a threshold.
TEST(Switching, EveryFeatureOnEveryControlletActsFromTheNextCycleOn) {
  const Registry registry = Registry::with_builtins();
  std::vector<InstanceConfig> configs;
  for (const auto& type : registry.controllets()) {
    InstanceConfig config{.name = "one_" + type.descriptor.type, .type = type.descriptor.type};
    for (ArmIndex arm = 0; arm < type.descriptor.arms; ++arm) config.arms.push_back(arm);
    for (ArmIndex k = 0; k < type.descriptor.observes; ++k)
      config.observes.push_back(type.descriptor.arms + k);
    config.parameters = {{"joint_limits.range_rad", {0.5}}, {"manipulability.threshold", {1}}};
    configs.push_back(config);
  }
  int acted = 0;
  for (const auto& config : configs) {
    TestLoop loop(2, configs, registry);
    for (ArmIndex arm = 0; arm < 2; ++arm) {
      JointVector q = loop.models[arm]->q_home();
      q[0] = 2.45;  // of 2.8
      loop.world.set_position(arm, q);
    }
    loop.step();
    ASSERT_TRUE(loop.ask({.activate = bit(loop.find(config.name))}).accepted()) << config.name;
    const Instance& instance = loop.modes().instance(loop.find(config.name));
    for (std::size_t f = 0; f < instance.feature_count(); ++f) {
      const std::string& feature = instance.feature_descriptor(f).type;
      for (const bool on : {true, false, true, false}) {
        for (const ArmIndex arm : config.arms) loop.world.set_velocity(arm, joint_constant(7, 0.02));
        const std::uint64_t before = loop.cycle.data().tick.cycle;
        const Answer answer = loop.ask({.kind = Kind::set_feature,
                                        .instance = loop.find(config.name),
                                        .index = static_cast<std::uint16_t>(f),
                                        .on = on});
        if (feature == "collision_avoidance") {  // these arms have no shapes that could collide
          EXPECT_EQ(answer.accepted(), !on) << config.name;
          EXPECT_EQ(instance.feature_refusal(f).substr(0, 33), "there is nothing to keep apart: a");
          EXPECT_FALSE(instance.feature_on(f));
          continue;
        }
        ASSERT_TRUE(answer.accepted()) << config.name << " " << feature;
        EXPECT_EQ(answer.cycle, before + 1);
        EXPECT_EQ(instance.feature_on(f), on);
        ASSERT_NE(loop.modes().active() & bit(loop.find(config.name)), 0u) << config.name << " " << feature;
        const double torque = loop.cycle.data().tau_feature[0].norm();
        EXPECT_EQ(torque > 0, on) << config.name << " " << feature;
        acted += torque > 0 ? 1 : 0;
      }
    }
  }
  EXPECT_EQ(acted, static_cast<int>(2 * 3 * configs.size()));
}

TEST(Switching, ABatchIsTakenInOneCycleHoweverLong) {
  TestLoop loop(4, four_arms(), test::test_registry());
  loop.step();
  std::vector<Request> single(10, Request{.kind = Kind::resume});
  std::vector<Request> batch(40, Request{.kind = Kind::resume});
  std::uint64_t first = 0, last = 0;
  ASSERT_EQ(loop.modes().post(single, first), Verdict::accepted);
  ASSERT_EQ(loop.modes().post(batch, last), Verdict::accepted);
  loop.steps(3);
  Answer answer, other;
  ASSERT_TRUE(loop.modes().poll(last, answer));
  for (std::uint64_t t = last - batch.size() + 1; t <= last; ++t) {
    ASSERT_TRUE(loop.modes().poll(t, other));
    EXPECT_EQ(other.cycle, answer.cycle);
  }
  EXPECT_EQ(loop.modes().post(std::vector<Request>(65, single[0]), last), Verdict::queue_full);
}

TEST(Switching, ScheduledRequestsAreExecutedInTheirCycle) {
  TestLoop loop(4, four_arms(), test::test_registry());
  std::vector<ScheduledRequest> timeline(3);
  timeline[0].at = LoopTime::from_seconds(0.020);
  timeline[0].request.activate = loop.set({"s1"});
  timeline[1].at = LoopTime::from_seconds(0.010);
  timeline[1].request.activate = loop.set({"p12"});
  timeline[2].at = LoopTime::from_seconds(0.030);
  timeline[2].what = ScheduledRequest::What::stop;
  timeline[2].stop = ArmSet::of(1);
  loop.modes().activate_at_start(loop.set({"s0"}));
  loop.modes().schedule(timeline);
  for (int k = 0; k < 40; ++k) {  // step k is at k ms
    loop.step();
    EXPECT_EQ(loop.modes().owner(0), loop.find("s0")) << k;
    const char* expected = k < 10 ? "arm1_hold" : k < 20 ? "p12" : k < 30 ? "s1" : "arm1_hold";
    EXPECT_EQ(loop.modes().owner(1), loop.find(expected)) << k;
  }
  EXPECT_EQ(loop.modes().stopped(), ArmSet::of(1));
}

TEST(Switching, AsManyScheduledRequestsAsThereAreAreTakenInOneCycle) {
  TestLoop loop(4, four_arms(), test::test_registry());
  std::vector<ScheduledRequest> timeline(500);
  for (ScheduledRequest& one : timeline) one.request.kind = Kind::resume;
  timeline.back().request = {.activate = loop.set({"s3"})};
  loop.modes().schedule(timeline);
  loop.step();
  EXPECT_EQ(loop.modes().owner(3), loop.find("s3"));
}

// Whatever the timeline has for the first moment comes after what is active at the start.
TEST(Switching, WhatIsActiveAtTheStartIsTakenBeforeTheTimeline) {
  TestLoop loop(4, four_arms(), test::test_registry());
  std::vector<ScheduledRequest> timeline(1);
  timeline[0].request.deactivate = loop.set({"s0"});
  loop.modes().schedule(timeline);
  loop.modes().activate_at_start(loop.set({"s0", "s1"}));
  loop.step();
  EXPECT_EQ(loop.modes().active(), loop.set({"arm0_hold", "s1", "arm2_hold", "arm3_hold"}));
}

TEST(Switching, ParametersOfInactiveControlletsAreSetAtOnce) {
  TestLoop loop(2, {}, test::test_registry());
  loop.step();
  Instance& hold = loop.modes().instance(0);
  const auto ratio = static_cast<std::uint16_t>(hold.find_parameter("damping_ratio"));
  Request set{.kind = Kind::set_parameter, .instance = 0, .index = ratio, .size = 1};
  set.values[0] = 0.5;
  ASSERT_TRUE(loop.ask(set).accepted());
  EXPECT_EQ(hold.parameter(ratio), std::vector<double>{0.5});
}

// The torques of the kept arm must not depend on the others in any cycle.
std::vector<JointVector> torques_of_arm0(bool others_switch) {
  TestLoop loop(4, four_arms(), test::test_registry());
  loop.modes().activate_at_start(loop.set({"s0"}));
  Draw draw(5);
  std::vector<JointVector> torques;
  const std::vector<std::string_view> names = {"s1", "s2", "s3", "p12", "p31", "f2", "refuser", "thrower"};
  for (int k = 0; k < 500; ++k) {
    if (others_switch) {
      Request request;
      (draw.coin() ? request.activate : request.deactivate) = bit(loop.find(names[draw.index(names.size())]));
      std::uint64_t ticket = 0;
      (void)loop.modes().post(std::span(&request, 1), ticket);
      if (draw.index(20) == 0) loop.modes().stop(ArmSet::of(1 + draw.index(3)));
    }
    loop.step();
    torques.push_back(loop.world.torque(0));
  }
  return torques;
}

TEST(Switching, KeptControlletsAreBitIdenticalToARunWithoutSwitches) {
  const auto quiet = torques_of_arm0(false), busy = torques_of_arm0(true);
  for (std::size_t k = 0; k < quiet.size(); ++k) ASSERT_EQ(quiet[k], busy[k]) << k;
}

TEST(Instance, RefusesMismatchedInput) {
  const auto refused = [](InstanceConfig config) {
    EXPECT_THROW(TestLoop(2, {config}, test::test_registry()), std::invalid_argument) << config.name;
  };
  refused({.name = "no such type", .type = "sprong", .arms = {0}});
  refused({.name = "no such arm", .type = "spring", .arms = {2}});
  refused({.name = "too few arms", .type = "pair", .arms = {0}});
  refused({.name = "arm twice", .type = "pair", .arms = {1, 1}});
  refused({.name = "feature", .type = "spring", .arms = {1}, .features = {"pull"}});
  refused({.name = "parameter", .type = "broken", .arms = {1}, .parameters = {{"folt", {1}}}});
  refused({.name = "choice", .type = "broken", .arms = {1}, .parameters = {{"fault", {1.5}}}});
  refused({.name = "input", .type = "follow", .arms = {1}, .inputs = {{.name = "jonts"}}});
  refused({.name = "arm0_hold", .type = "spring", .arms = {0}});
  EXPECT_THROW(
      TestLoop(1,
               {{.name = "a", .type = "spring", .arms = {0}}, {.name = "a", .type = "spring", .arms = {0}}},
               test::test_registry()),
      std::invalid_argument);
}

}  // namespace
}  // namespace multipanda::switching_test
