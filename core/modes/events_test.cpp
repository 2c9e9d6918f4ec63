#include <cmath>
#include <span>
#include <vector>

#include <gtest/gtest.h>

#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"

// The log's events: what happened, when, to which arm, on whose request.
namespace multipanda::events_test {
namespace {

using test::TestLoop;
using Kind = Request::Kind;

struct Events : testing::Test {
  Events()
      : loop(3,
             {{.name = "s0", .type = "spring", .arms = {0}},
              {.name = "bad", .type = "broken", .arms = {1}},
              {.name = "p12", .type = "pair", .arms = {1, 2}},
              {.name = "f2", .type = "follow", .arms = {2}},
              {.name = "refuser", .type = "refuser", .arms = {1}}},
             test::test_registry(), 64) {
    loop.step();
    (void)taken();
  }

  // All since the last call. Each has the time of the newest cycle, which caused it.
  std::vector<Event> taken() {
    std::vector<Event> events;
    RecordRing& ring = *loop.cycle.record();
    for (const Event* event; (event = ring.events.front()) != nullptr; ring.events.pop()) {
      events.push_back(*event);
      EXPECT_EQ(event->cycle, loop.cycle.data().tick.cycle);
      EXPECT_EQ(event->t, loop.cycle.data().tick.t);
    }
    while (ring.ring.front() != nullptr) ring.ring.pop();
    return events;
  }
  // The only one since the last call.
  Event only() {
    const auto events = taken();
    EXPECT_EQ(events.size(), 1u);
    return events.empty() ? Event{} : events.front();
  }
  Answer ask(const Request& request) {
    Answer answer;
    const HostTime before = host_now();
    EXPECT_EQ(loop.modes().post(std::span(&request, 1), ticket), Verdict::accepted);
    loop.step();
    EXPECT_TRUE(loop.modes().poll(ticket, answer));
    EXPECT_EQ(answer.kind, request.kind);
    EXPECT_EQ(answer.ticket, ticket);
    EXPECT_EQ(answer.cycle, loop.cycle.data().tick.cycle);
    EXPECT_EQ(answer.t, loop.cycle.data().tick.t);
    EXPECT_LE(before, answer.received);
    EXPECT_LE(answer.received, answer.taken);
    EXPECT_LT(loop.cycle.data().tick.start, answer.taken) << "posted before the step, taken in it";
    EXPECT_LT(answer.taken, answer.first_torque);
    EXPECT_EQ(loop.cycle.record()->dropped_events, 0u);
    return answer;
  }
  void expect_of_request(const Event& event, EventKind kind, Verdict verdict, const char* instance,
                         std::uint16_t index) {
    EXPECT_EQ(event.kind, kind);
    EXPECT_EQ(event.verdict, verdict);
    EXPECT_EQ(event.ticket, ticket);
    EXPECT_EQ(event.instance, loop.find(instance));
    EXPECT_EQ(event.index, index);
  }

  TestLoop loop;
  std::uint64_t ticket = 0;
};

TEST_F(Events, OfParameters) {
  const Instance& pair = loop.modes().instance(loop.find("p12"));
  const auto index = static_cast<std::uint16_t>(pair.find_parameter("push.torque_nm"));
  Request request{.kind = Kind::set_parameter, .instance = loop.find("p12"), .index = index, .size = 1};
  request.values[0] = 7;
  request.values[1] = 8;
  ask(request);
  const Event event = only();
  expect_of_request(event, EventKind::parameter_set, Verdict::accepted, "p12", index);
  EXPECT_EQ(event.size, 1);
  EXPECT_EQ(event.values[0], 7);
  EXPECT_EQ(event.values[1], 0);
  EXPECT_EQ(pair.parameter(index), std::vector<double>{7});
}

TEST_F(Events, OfFeatures) {
  const auto push = static_cast<std::uint16_t>(loop.modes().instance(loop.find("p12")).find_feature("push"));
  for (const bool on : {true, false}) {
    ask({.kind = Kind::set_feature, .instance = loop.find("p12"), .index = push, .on = on});
    const Event event = only();
    expect_of_request(event, EventKind::feature_set, Verdict::accepted, "p12", push);
    EXPECT_EQ(event.size, 1);
    EXPECT_EQ(event.values[0], on ? 1 : 0);
  }
}

TEST_F(Events, OfTargets) {
  Request request{.kind = Kind::set_target, .instance = loop.find("f2")};
  Target& target = request.target;
  target.size = 7;
  for (std::size_t i = 0; i < 7; ++i) target.values[i] = 0.1 * static_cast<double>(i + 1);
  EXPECT_EQ(ask(request).verdict, Verdict::not_active);
  Event event = only();
  expect_of_request(event, EventKind::target_set, Verdict::not_active, "f2", 0);
  ASSERT_TRUE(loop.activate({"f2"}).accepted());
  (void)taken();
  EXPECT_EQ(ask(request).verdict, Verdict::accepted);
  event = only();
  expect_of_request(event, EventKind::target_set, Verdict::accepted, "f2", 0);
  ASSERT_EQ(event.size, 7);
  for (std::size_t i = 0; i < 14; ++i) EXPECT_EQ(event.values[i], i < 7 ? target.values[i] : 0);
  // A motion: its rise, then its sine.
  target.delivery = Delivery::motion;
  target.values.fill(0);
  for (std::size_t i = 0; i < 7; ++i) target.sine[i] = 0.001 * static_cast<double>(i + 1);
  target.period_s = 2;
  target.cycles = 3;
  target.ramp_s = 1;
  EXPECT_EQ(ask(request).verdict, Verdict::accepted);
  event = only();
  ASSERT_EQ(event.size, 14);
  for (std::size_t i = 0; i < 7; ++i) {
    EXPECT_EQ(event.values[i], 0);
    EXPECT_EQ(event.values[7 + i], target.sine[i]);
  }
}

TEST_F(Events, OfSwitches) {
  loop.steps(3);
  loop.world.set_velocity(1, joint_constant(7, 0.1));  // so that the laws' torques differ at the hand-over
  const JointVector before = loop.world.torque(1);
  const Answer answer = ask({.activate = loop.set({"p12"})});
  const Event event = only();
  EXPECT_EQ(event.kind, EventKind::switched);
  EXPECT_EQ(event.verdict, Verdict::accepted);
  EXPECT_EQ(event.intervention, Intervention::none);
  EXPECT_EQ(event.ticket, ticket);
  EXPECT_EQ(event.started, loop.set({"p12"}));
  EXPECT_EQ(event.stopped, loop.set({"arm1_hold", "arm2_hold"}));
  EXPECT_EQ(event.kept, loop.set({"arm0_hold"}));
  EXPECT_EQ(event.arms, 0b110u);
  EXPECT_EQ(event.received, answer.received);
  EXPECT_EQ(event.taken, answer.taken);
  EXPECT_EQ(event.first_torque, answer.first_torque);
  ASSERT_EQ(event.size, 6);
  const CycleData& data = loop.cycle.data();
  const JointVector requested = data.tau_controllet[1] + data.tau_feature[1];
  EXPECT_DOUBLE_EQ(event.values[2], (requested - before).lpNorm<Eigen::Infinity>());
  EXPECT_DOUBLE_EQ(event.values[3], (loop.world.torque(1) - before).lpNorm<Eigen::Infinity>());
  EXPECT_GT(event.values[3], 0);
  EXPECT_EQ(event.values[0], 0) << "the first arm was not handed over";
  EXPECT_EQ(event.values[1], 0);
  for (const ArmIndex arm : {0, 1, 2}) {
    EXPECT_EQ(answer.step_requested[arm], event.values[2 * arm]);
    EXPECT_EQ(answer.step_sent[arm], event.values[2 * arm + 1]);
  }
  loop.step();
  EXPECT_TRUE(taken().empty());
  const Answer of_first = ask({.activate = loop.set({"s0"})});
  const Event next = only();
  EXPECT_GT(next.values[0], 0);
  EXPECT_EQ(next.values[0], of_first.step_requested[0]);
  for (std::size_t i = 2; i < 6; ++i) EXPECT_EQ(next.values[i], 0) << "of this switch only";
}

// Nobody asked: such a switch was received and taken when the step began.
TEST_F(Events, OfScheduledSwitches) {
  std::vector<ScheduledRequest> timeline(1);
  timeline[0].request.activate = loop.set({"s0"});
  loop.modes().schedule(timeline);
  loop.step();
  const Event event = only();
  EXPECT_EQ(event.kind, EventKind::switched);
  EXPECT_EQ(event.ticket, 0u);
  EXPECT_EQ(event.started, loop.set({"s0"}));
  EXPECT_EQ(event.received, loop.cycle.data().tick.start);
  EXPECT_EQ(event.taken, loop.cycle.data().tick.start);
  EXPECT_LT(event.taken, event.first_torque);
}

// The steps of a switch's event are those of all arms that got a new owner in its cycle.
TEST_F(Events, OfSwitchesHaveTheStepsOfInterventionsOfTheirCycle) {
  ASSERT_TRUE(loop.activate({"p12"}).accepted());
  (void)taken();
  loop.world.set_velocity(1, joint_constant(7, 0.1));
  loop.world.tamper = [](ArmIndex arm, std::uint64_t, ArmState& state) {
    if (arm == 2) state.dq[5] = -2.75;
  };
  const Answer answer = ask({.activate = loop.set({"s0"})});
  EXPECT_EQ(loop.modes().active(), loop.set({"s0", "arm1_hold", "arm2_hold"}));
  EXPECT_GT(answer.step_sent[1], 0);
}

TEST(FirstEvents, OfASwitchHaveRoomForEveryArm) {
  TestLoop loop(kMaxArms, {{.name = "last", .type = "spring", .arms = {kMaxArms - 1}}}, test::test_registry(),
                256);
  loop.step();
  RecordRing& ring = *loop.cycle.record();
  while (ring.events.front() != nullptr) ring.events.pop();
  ASSERT_TRUE(loop.activate({"last"}).accepted());
  const Event& event = *ring.events.front();
  EXPECT_EQ(event.size, 2 * kMaxArms);
  EXPECT_EQ(event.arms, 1u << (kMaxArms - 1));
  EXPECT_GT(event.values[2 * kMaxArms - 1], 0);
  EXPECT_EQ(event.values[2 * kMaxArms], 0) << "behind the last one";
}

// The log begins with what each arm is set to, also if that has never changed.
TEST(FirstEvents, NameTheConfigurationOfEveryArm) {
  TestLoop loop(2, {}, test::test_registry(), 64);
  loop.step();
  std::vector<std::uint16_t> arms;
  RecordRing& ring = *loop.cycle.record();
  for (const Event* event; (event = ring.events.front()) != nullptr; ring.events.pop()) {
    if (event->kind != EventKind::arm_config) continue;
    EXPECT_EQ(event->index, 0);
    arms.push_back(event->arm);
  }
  EXPECT_EQ(arms, (std::vector<std::uint16_t>{0, 1}));
}

TEST_F(Events, OfRefusedSwitches) {
  EXPECT_EQ(ask({.activate = loop.set({"refuser"})}).verdict, Verdict::start_refused);
  const Event event = only();
  EXPECT_EQ(event.kind, EventKind::switch_refused);
  EXPECT_EQ(event.verdict, Verdict::start_refused);
  EXPECT_EQ(event.ticket, ticket);
  EXPECT_EQ(event.started, loop.set({"refuser"}));
  for (const double step : event.values) EXPECT_EQ(step, 0);
}

TEST_F(Events, OfStopsAndResumes) {
  ASSERT_TRUE(loop.activate({"p12"}).accepted());
  (void)taken();
  loop.modes().stop(ArmSet::from_bits(0b1000010));  // there is no arm 6
  loop.step();
  const auto events = taken();
  ASSERT_EQ(events.size(), 2u);
  EXPECT_EQ(events[0].kind, EventKind::stopped);
  EXPECT_EQ(events[0].arms, 0b10u);
  EXPECT_EQ(events[0].ticket, 0u);
  EXPECT_EQ(events[1].kind, EventKind::switched);
  EXPECT_EQ(events[1].intervention, Intervention::stop_requested);
  EXPECT_EQ(events[1].instance, loop.find("p12"));
  EXPECT_EQ(events[1].arm, 1);
  EXPECT_EQ(events[1].started, loop.set({"arm1_hold", "arm2_hold"}));
  EXPECT_EQ(events[1].stopped, loop.set({"p12"}));
  EXPECT_EQ(events[1].kept, loop.set({"arm0_hold"}));
  ask({.kind = Kind::resume, .arms = ArmSet::of(1)});
  const Event event = only();
  EXPECT_EQ(event.kind, EventKind::resumed);
  EXPECT_EQ(event.ticket, ticket);
  EXPECT_EQ(event.arms, 0b10u);
}

// An arm that is too fast: the rule with its numbers, then what runs instead.
TEST_F(Events, OfInterventions) {
  ASSERT_TRUE(loop.activate({"p12"}).accepted());
  (void)taken();
  loop.world.tamper = [](ArmIndex arm, std::uint64_t, ArmState& state) {
    if (arm == 2) state.dq[5] = -2.75;
  };
  loop.step();
  loop.world.tamper = nullptr;
  auto events = taken();
  ASSERT_GE(events.size(), 2u);
  EXPECT_EQ(events[0].kind, EventKind::intervention);
  EXPECT_EQ(events[0].intervention, Intervention::joint_velocity_limit);
  EXPECT_EQ(events[0].arm, 2);
  EXPECT_EQ(events[0].joint, 5);
  EXPECT_EQ(events[0].instance, loop.find("p12"));
  ASSERT_EQ(events[0].size, 2);
  EXPECT_EQ(events[0].values[0], -2.75);
  EXPECT_EQ(events[0].values[1], 2.5);
  EXPECT_EQ(events[1].kind, EventKind::switched);
  EXPECT_EQ(events[1].intervention, Intervention::joint_velocity_limit);
  EXPECT_EQ(events[1].arm, 2);
  EXPECT_EQ(events[1].stopped, loop.set({"p12"}));
}

// A law whose torque cannot be reached at once is clamped in many cycles, and reported when that begins.
TEST_F(Events, OfClampedTorquesBeginAnEpisode) {
  const auto clamps = [this] {
    std::vector<Event> found;
    for (const Event& event : taken()) {
      if (event.kind == EventKind::intervention) found.push_back(event);
    }
    return found;
  };
  ASSERT_TRUE(loop.activate({"p12"}).accepted());
  (void)taken();
  for (int episode = 0; episode < 2; ++episode) {
    loop.world.set_velocity(2, joint_constant(7, 2));  // -2 N m s/rad: more than a step of 1 N m
    loop.step();
    const auto first = clamps();
    ASSERT_EQ(first.size(), 1u);
    EXPECT_EQ(first[0].intervention, Intervention::torque_rate_clamped);
    EXPECT_EQ(first[0].arm, 2);
    EXPECT_EQ(first[0].instance, loop.find("p12"));
    EXPECT_EQ(first[0].values[1], 1000);
    loop.world.set_velocity(2, joint_constant(7, 2));
    loop.step();
    EXPECT_TRUE(clamps().empty()) << "the same episode";
    for (int k = 0; k < 20; ++k) {
      loop.world.set_velocity(2, joint_constant(7, 0));
      loop.step();
      (void)taken();
    }
  }
}

TEST_F(Events, OfModesAndConfigurations) {
  loop.world.tamper = [](ArmIndex arm, std::uint64_t, ArmState& state) {
    if (arm != 1) return;
    state.mode = ArmMode::guiding;
    state.config_version = 9;
    state.frames.X_FE = {exp_rotation(Vector3(0, 0, 2 * std::acos(0.8))), Vector3(1, 2, 3)};
    state.frames.X_EK = {exp_rotation(Vector3(2 * std::acos(0.6), 0, 0)), Vector3(4, 5, 6)};
    Matrix3 inertia;
    inertia << 11, 12, 13, 12, 14, 15, 13, 15, 16;
    state.tool = {.mass = 7, .p_FC = Vector3(8, 9, 10), .inertia_C = inertia};
    state.load = {.mass = 17, .p_FC = Vector3(18, 19, 20), .inertia_C = 2 * inertia};
  };
  loop.step();
  const auto events = taken();
  ASSERT_EQ(events.size(), 2u);
  EXPECT_EQ(events[0].kind, EventKind::arm_mode);
  EXPECT_EQ(events[0].arm, 1);
  EXPECT_EQ(events[0].index, static_cast<std::uint16_t>(ArmMode::guiding));
  EXPECT_EQ(events[1].kind, EventKind::arm_config);
  EXPECT_EQ(events[1].arm, 1);
  EXPECT_EQ(events[1].index, 9);
  const std::vector<double> expected = {1,  2,  3,  0.8, 0,  0,  0.6, 4,  5,  6,  0.6, 0.8,
                                        0,  0,  7,  8,   9,  10, 11,  12, 13, 14, 15,  16,
                                        17, 18, 19, 20,  22, 24, 26,  28, 30, 32};
  ASSERT_EQ(events[1].size, expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(events[1].values[i], expected[i], 1e-12) << i;
  loop.steps(3);
  EXPECT_TRUE(taken().empty()) << "once";
}

}  // namespace
}  // namespace multipanda::events_test
