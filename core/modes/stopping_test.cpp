#include <array>
#include <vector>

#include <gtest/gtest.h>

#include "core/testing/test_laws.hpp"
#include "core/testing/test_world.hpp"

// After a stop nothing moves an arm: neither its hold, nor what was asked for before, nor the schedule.
namespace multipanda::stopping_test {
namespace {

using test::TestLoop;
using Kind = Request::Kind;

struct Stopping : testing::Test {
  static std::vector<InstanceConfig> laws() {
    return {{.name = "s0", .type = "spring", .arms = {0}},
            {.name = "s1", .type = "spring", .arms = {1}},
            {.name = "refuser", .type = "refuser", .arms = {0}}};
  }
  Stopping() : loop(2, laws(), test::test_registry()) {}

  std::uint64_t post(std::span<const Request> requests) {
    std::uint64_t ticket = 0;
    EXPECT_EQ(loop.modes().post(requests, ticket), Verdict::accepted);
    return ticket;
  }
  // As many as the loop takes in one step: what is posted next waits for the one after.
  void fill_a_step() {
    for (int i = 0; i < 16; ++i) post(std::array{Request{.kind = Kind::resume}});
  }
  Verdict verdict(std::uint64_t ticket) {
    Answer answer;
    EXPECT_TRUE(loop.modes().poll(ticket, answer));
    return answer.verdict;
  }
  bool runs(const char* name) { return (loop.modes().active() & loop.set({name})) != 0; }

  TestLoop loop;
};

// Its hold was bringing a joint back to its limit, with its set-point ahead of it.
TEST_F(Stopping, TheHoldOfAStoppedArmLeadsNoJointBack) {
  const double limit = loop.models[0]->limits().q_max[0];
  JointVector q = loop.world.position(0);
  q[0] = limit + 0.3;
  loop.world.set_position(0, q);
  loop.steps(800);
  const double moving = loop.world.position(0)[0];
  EXPECT_LT(moving, limit + 0.28);
  EXPECT_GT(moving, limit + 0.1);
  loop.modes().stop(ArmSet::of(0));
  loop.step();
  const JointVector stopped_at = loop.world.position(0);
  loop.steps(3000);
  EXPECT_LT((loop.world.position(0) - stopped_at).lpNorm<Eigen::Infinity>(), 0.01);
  const JointVector rest = loop.world.position(0);
  loop.steps(3000);
  EXPECT_LT((loop.world.position(0) - rest).lpNorm<Eigen::Infinity>(), 1e-4);
  EXPECT_TRUE(loop.ask({.kind = Kind::resume, .arms = ArmSet::of(0)}).accepted());
  loop.steps(8000);
  EXPECT_NEAR(loop.world.position(0)[0], limit, 1e-3);
}

// Its stiffness rose against a push, and its set-point was coming back.
TEST_F(Stopping, TheHoldOfAStoppedArmBearsWhatARaisedStiffnessBore) {
  loop.step();
  const JointVector pushed = loop.world.position(0) + 0.05 * joint_constant(7, 1);
  const auto steps = [&](int count) {
    for (; count > 0; --count) {
      loop.world.set_position(0, pushed);
      loop.world.set_velocity(0, joint_constant(7, 0));
      loop.step();
    }
    return loop.cycle.data().tau_controllet[0];
  };
  steps(1);
  Request value{.kind = Kind::set_parameter, .instance = loop.find("arm0_hold"), .size = 7};
  value.index = static_cast<std::uint16_t>(
      loop.modes().instance(value.instance).find_parameter("stiffness_nm_per_rad"));
  value.values.fill(900);
  post(std::array{value});
  const JointVector raised = steps(210);
  loop.modes().stop(ArmSet::of(0));
  const JointVector stopped = steps(1);
  EXPECT_LT((stopped - raised).norm(), 0.2);
  EXPECT_LT((steps(500) - stopped).norm(), 1e-9);
  ASSERT_TRUE(loop.ask({.kind = Kind::resume, .arms = ArmSet::of(0)}).accepted());
  EXPECT_GT(steps(3000).norm(), 1.2 * stopped.norm()) << "it had not come back";
}

// The same of an arm that its controllet owned when it was stopped.
TEST_F(Stopping, AnArmThatIsStoppedBeyondItsLimitStaysThere) {
  ASSERT_TRUE(loop.activate({"s0"}).accepted());
  const double limit = loop.models[0]->limits().q_max[0];
  JointVector q = loop.world.position(0);
  q[0] = limit + 0.01;
  loop.world.set_position(0, q);
  loop.world.set_velocity(0, joint_constant(7, 0));
  loop.modes().stop(ArmSet::of(0));
  loop.steps(2000);
  EXPECT_NEAR(loop.world.position(0)[0], limit + 0.01, 1e-3);
}

// A feature pushes all joints of a held arm with 0.5 N m, by up to that over the stiffness of the hold. A
// stop leaves the arm where it is: on its way, where it has come to rest, and where its controllet had it.
TEST_F(Stopping, FeaturesOfAHoldMoveNoStoppedArm) {
  Request push{.kind = Kind::set_feature, .instance = loop.find("arm0_hold"), .on = true};
  push.index = static_cast<std::uint16_t>(loop.modes().instance(push.instance).find_feature("push"));
  const auto tau = [&] { return loop.cycle.data().tau_feature[0]; };
  for (const int cycles : {60, 2000, 0}) {
    if (cycles == 0) {
      ASSERT_TRUE(loop.activate({"s0"}).accepted());
    } else {
      ASSERT_TRUE(loop.ask(push).accepted());
    }
    loop.steps(static_cast<std::size_t>(cycles));
    const JointVector before = tau();
    loop.modes().stop(ArmSet::of(0));
    loop.step();
    if (cycles == 2000) {
      EXPECT_LT((tau() - before).norm(), 1e-3) << "it rests on the spring, which bears it";
      EXPECT_NEAR(before[0], 0.5, 1e-12);
    } else {
      EXPECT_LT(tau().norm(), cycles == 0 ? 1e-12 : 0.9 * before.norm());
    }
    const JointVector kept = tau(), stopped_at = loop.world.position(0);
    loop.steps(3000);
    EXPECT_EQ(tau(), kept);
    EXPECT_LT((loop.world.position(0) - stopped_at).lpNorm<Eigen::Infinity>(), 1e-4) << cycles;
    ASSERT_TRUE(loop.ask({.kind = Kind::resume, .arms = ArmSet::of(0)}).accepted());
    EXPECT_LT((tau() - kept).lpNorm<Eigen::Infinity>(), 1.01 * 0.5 / 200);
    loop.steps(250);
    EXPECT_LT((tau() - joint_constant(7, 0.5)).norm(), 1e-9);
  }
}

// Its hold would go on with the state of that cycle: no spring, no damping.
TEST_F(Stopping, AFeatureThatThrowsLeavesTheHoldItsState) {
  Request push{.kind = Kind::set_feature, .instance = loop.find("arm0_hold"), .on = true};
  Instance& hold = loop.modes().instance(push.instance);
  push.index = static_cast<std::uint16_t>(hold.find_feature("push"));
  Request value{.kind = Kind::set_parameter, .instance = push.instance, .size = 1, .values = {-99}};
  value.index = static_cast<std::uint16_t>(hold.find_parameter("push.torque_nm"));
  ASSERT_TRUE(loop.ask(value).accepted());
  ASSERT_TRUE(loop.ask(push).accepted());
  loop.modes().stop(ArmSet::of(0));
  loop.steps(2);
  loop.world.set_position(0, loop.world.position(0) + JointVector(0.05 * JointVector::Unit(7, 3)));
  loop.world.set_velocity(0, joint_constant(7, 0));
  const double before = loop.cycle.data().tau_controllet[0][3];
  loop.steps(2);
  EXPECT_LT(loop.cycle.data().tau_controllet[0][3], before - 0.05 * 50);
}

TEST_F(Stopping, WhatWasPostedBeforeAStopDoesNotRunAfterIt) {
  loop.step();
  fill_a_step();
  const std::array batch{Request{.activate = loop.set({"s1"})},
                         Request{.kind = Kind::resume, .arms = ArmSet::of(0)},
                         Request{.activate = loop.set({"s0"})}};
  const std::uint64_t last = post(batch);
  loop.modes().stop(ArmSet::of(0));
  loop.steps(5);
  for (std::uint64_t ticket = last - 2; ticket <= last; ++ticket)
    EXPECT_EQ(verdict(ticket), Verdict::arm_stopped);
  EXPECT_TRUE(loop.modes().stopped().contains(ArmIndex{0}));
  EXPECT_FALSE(runs("s0"));
  EXPECT_FALSE(runs("s1"));  // of another arm, but of the same batch
  // A sender that knows of the stop may resume.
  EXPECT_TRUE(loop.ask({.kind = Kind::resume, .arms = ArmSet::of(0)}).accepted());
  EXPECT_TRUE(loop.activate({"s0", "s1"}).accepted());
}

// It waited behind answers that its sender did not read, and the arm has been resumed meanwhile.
TEST_F(Stopping, WhatWasAskedBeforeAStopDoesNotRunAfterTheResume) {
  loop.step();
  const HostTime before = host_now();
  loop.modes().stop(ArmSet::of(0));
  loop.step();
  EXPECT_TRUE(loop.ask({.kind = Kind::resume, .arms = ArmSet::of(0)}).accepted());
  const Request start{.activate = loop.set({"s0"})};
  std::uint64_t ticket = 0;
  ASSERT_EQ(loop.modes().post(std::span(&start, 1), ticket, MultimodeController::kPatience, before),
            Verdict::accepted);
  loop.step();
  EXPECT_EQ(verdict(ticket), Verdict::arm_stopped);
  EXPECT_FALSE(runs("s0"));
  EXPECT_TRUE(loop.activate({"s0"}).accepted());
}

// Both wait for the same boundary, where the stop acts last.
TEST_F(Stopping, WhatIsPostedWithAStopIsRefused) {
  loop.step();
  loop.modes().stop(ArmSet::of(0));
  const std::array resume{Request{.kind = Kind::resume, .arms = ArmSet::of(0)}};
  const std::array start{Request{.activate = loop.set({"s1"})}};
  const std::uint64_t first = post(resume), second = post(start);
  loop.step();
  EXPECT_EQ(verdict(first), Verdict::arm_stopped);
  EXPECT_EQ(verdict(second), Verdict::accepted) << "an arm that nobody stopped";
  EXPECT_EQ(loop.modes().stopped(), ArmSet::of(0));
}

// Somebody else stops the arm again, before a resume of the first stop comes, which was asked after it.
TEST_F(Stopping, AResumeEndsNoStopThatItsAskerHasNotSeen) {
  const auto resume = [&](ArmSet arms, std::uint32_t stops) {
    return loop.ask({.kind = Kind::resume, .arms = arms, .stops = stops}).verdict;
  };
  loop.modes().stop(ArmSet::of(0));
  loop.step();
  const std::uint32_t seen = loop.modes().stops();
  EXPECT_EQ(seen, 1u);
  loop.modes().stop(ArmSet::of(1));
  loop.step();
  EXPECT_EQ(resume(ArmSet::all(2), seen), Verdict::arm_stopped);
  EXPECT_EQ(loop.modes().stopped(), ArmSet::all(2));
  EXPECT_EQ(resume(ArmSet::of(0), seen), Verdict::accepted) << "the other arm's stop is not its own";
  EXPECT_EQ(loop.modes().stopped(), ArmSet::of(1));
  loop.modes().stop(ArmSet::of(1));  // of an arm that is stopped already
  loop.step();
  EXPECT_EQ(resume(ArmSet::of(1), seen + 1), Verdict::arm_stopped);
  EXPECT_EQ(resume(ArmSet::of(1), loop.modes().stops()), Verdict::accepted);
  EXPECT_TRUE(loop.modes().stopped().empty());
}

// Whichever request of the batch the stop has overtaken.
TEST_F(Stopping, ABatchIsOvertakenByAnyOfItsRequests) {
  loop.step();
  const Request resume{.kind = Kind::resume, .arms = ArmSet::of(0)}, start{.activate = loop.set({"s1"})};
  for (const std::array<Request, 2>& batch : {std::array{resume, start}, std::array{start, resume}}) {
    fill_a_step();
    const std::uint64_t last = post(batch);
    loop.modes().stop(ArmSet::of(0));
    loop.steps(5);
    EXPECT_EQ(verdict(last - 1), Verdict::arm_stopped);
    EXPECT_EQ(verdict(last), Verdict::arm_stopped);
    EXPECT_TRUE(loop.modes().stopped().contains(ArmIndex{0}));
    EXPECT_FALSE(runs("s1"));
    EXPECT_TRUE(loop.ask(resume).accepted());
  }
}

TEST_F(Stopping, ACallIsNotOvertakenWithTheOneBehindIt) {
  loop.step();
  fill_a_step();
  const std::uint64_t other = post(std::array{Request{.activate = loop.set({"s1"})}}),
                      overtaken = post(std::array{Request{.activate = loop.set({"s0"})}});
  loop.modes().stop(ArmSet::of(0));
  loop.steps(3);
  EXPECT_EQ(verdict(other), Verdict::accepted);
  EXPECT_EQ(verdict(overtaken), Verdict::arm_stopped);
  EXPECT_TRUE(runs("s1"));
}

TEST_F(Stopping, FromItsFirstRefusalOnABatchIsRefused) {
  loop.step();
  const std::uint64_t last =
      post(std::array{Request{.activate = loop.set({"refuser"})}, Request{.activate = loop.set({"s1"})}});
  loop.steps(2);
  EXPECT_EQ(verdict(last - 1), Verdict::start_refused);
  EXPECT_EQ(verdict(last), Verdict::start_refused);
  EXPECT_FALSE(runs("s1"));
}

// A timeline stops both arms and resumes them; meanwhile somebody stops the first one.
TEST_F(Stopping, TheScheduleDoesNotResumeWhatSomebodyStopped) {
  for (const bool somebody : {false, true}) {
    TestLoop timed(2, laws(), test::test_registry());
    std::vector<ScheduledRequest> timeline(4);
    timeline[0] = {.at = LoopTime::from_seconds(0.005),
                   .what = ScheduledRequest::What::stop,
                   .request = {},
                   .stop = ArmSet::all(2)};
    timeline[1].at = LoopTime::from_seconds(0.020);
    timeline[1].request = {.kind = Kind::resume, .arms = ArmSet::all(2)};
    timeline[2].at = timeline[3].at = LoopTime::from_seconds(0.030);
    timeline[2].request.activate = timed.set({"s0"});
    timeline[3].request.activate = timed.set({"s1"});
    timed.modes().schedule(timeline);
    timed.steps(10);
    EXPECT_EQ(timed.modes().stopped().bits(), 3u);
    if (somebody) timed.modes().stop(ArmSet::of(0));
    timed.steps(40);
    EXPECT_EQ(timed.modes().active(), timed.set({somebody ? "arm0_hold" : "s0", "s1"}));
    if (!somebody) continue;
    EXPECT_TRUE(timed.ask({.kind = Kind::resume, .arms = ArmSet::of(0)}).accepted());
    EXPECT_TRUE(timed.activate({"s0"}).accepted());
  }
}

// What somebody stopped and resumed is the schedule's again.
TEST_F(Stopping, TheScheduleResumesAfterwardsWhatItStopsItself) {
  std::vector<ScheduledRequest> timeline(2);
  timeline[0] = {.at = LoopTime::from_seconds(0.020),
                 .what = ScheduledRequest::What::stop,
                 .request = {},
                 .stop = ArmSet::of(0)};
  timeline[1].at = LoopTime::from_seconds(0.030);
  timeline[1].request = {.kind = Kind::resume, .arms = ArmSet::of(0)};
  loop.modes().schedule(timeline);
  loop.step();
  loop.modes().stop(ArmSet::all(2));
  loop.steps(2);
  EXPECT_TRUE(loop.ask({.kind = Kind::resume, .arms = ArmSet::of(0)}).accepted());
  loop.steps(20);
  EXPECT_EQ(loop.modes().stopped(), ArmSet::all(2));
  loop.steps(20);
  EXPECT_EQ(loop.modes().stopped(), ArmSet::of(1));
}

}  // namespace
}  // namespace multipanda::stopping_test
