// When the controllets of a hosted cycle's scene start, and what takes precedence.
#include <cmath>

#include <gtest/gtest.h>

#include "runtime/embedded/hosted_cycle.hpp"
#include "runtime/embedded/testing/signal_fixture.hpp"

namespace multipanda::hosted_start_test {
namespace {

using test::Fixture;
using test::kFirstStart;

// A third controllet that may own the left arm.
const char* const kChoice =
    "controllets:\n"
    "  left_joints: {type: joint_impedance, arms: left}\n"
    "  left_pose: {type: cartesian_impedance, arms: left}\n"
    "  right_pose: {type: cartesian_impedance, arms: right}\n"
    "active: [left_joints, right_pose]\n";

TEST(HostedStart, ControlletsStartInTheVeryFirstStep) {
  Fixture fixture;
  fixture.cycle->activate();
  fixture.step();
  EXPECT_TRUE(fixture.runs("left_joints") && fixture.runs("right_pose"));
  EXPECT_EQ(fixture.cycle->data().tick.cycle, 1u);
}

TEST(HostedStart, LaterTheyStartOnceTheirArmsHaveSettled) {
  Fixture fixture;
  for (int round = 0; round < 3; ++round) {
    const std::lock_guard busy(fixture.counting->mutex);  // the relay thread must not interfere
    fixture.cycle->activate();
    for (int i = 1; i < 6; ++i) {
      fixture.step();
      EXPECT_EQ(fixture.runs("left_joints"), round == 0 || i >= kFirstStart) << round << " " << i;
      EXPECT_EQ(fixture.runs("right_pose"), round == 0 || i >= kFirstStart) << round << " " << i;
    }
    fixture.cycle->deactivate();
  }
}

// A user's switch takes precedence over the scene's start, however busy the computer is: the relay sees
// nothing before the user's switch was taken.
TEST(HostedStart, AUsersSwitchInTheFirstStepsTakesPrecedence) {
  Fixture fixture(kChoice);
  {
    const std::lock_guard busy(fixture.counting->mutex);
    fixture.cycle->activate();
    fixture.steps(10);
    ASSERT_EQ(fixture.activate("left_pose"), Verdict::accepted);
    fixture.step();
    ASSERT_TRUE(fixture.runs("left_pose"));
  }
  ASSERT_TRUE(fixture.relayed());
  std::this_thread::sleep_for(std::chrono::milliseconds(5));
  fixture.steps(50);
  EXPECT_TRUE(fixture.runs("left_pose") && fixture.runs("right_pose"));
  EXPECT_EQ(fixture.starts("left_joints"), 1);  // in the first step
}

// The same at a later activation, with the user's switch taken before, in and after the step in which the
// start is due. Before its arms take commands again, a switch is refused and the scene's start follows.
TEST(HostedStart, AUsersSwitchTakesPrecedenceInAnyStep) {
  for (int when = 1; when <= kFirstStart + 1; ++when) {
    Fixture fixture(kChoice);
    fixture.cycle->activate();
    fixture.step();
    fixture.cycle->deactivate();
    ASSERT_TRUE(fixture.relayed());
    const int before = fixture.starts("left_joints");
    fixture.cycle->activate();
    fixture.steps(when - 1);
    ASSERT_EQ(fixture.activate("left_pose"), Verdict::accepted);
    fixture.steps(20);
    const bool too_soon = when == 1;
    EXPECT_EQ(fixture.runs("left_pose"), !too_soon) << when;
    EXPECT_EQ(fixture.runs("left_joints"), too_soon) << when;
    EXPECT_TRUE(fixture.runs("right_pose")) << when;  // no request concerned this arm
    ASSERT_TRUE(fixture.relayed());
    // It was not even started and stopped at once.
    EXPECT_EQ(fixture.starts("left_joints") - before, when == 1 || when > kFirstStart ? 1 : 0) << when;
  }
}

TEST(HostedStart, WhatAUserSwitchedOffOrStoppedStaysOff) {
  for (int when = 1; when <= kFirstStart; ++when) {
    for (const bool stop : {false, true}) {
      Fixture fixture;
      fixture.cycle->activate();
      fixture.step();
      fixture.cycle->deactivate();
      ASSERT_TRUE(fixture.relayed());
      const int before = fixture.starts("left_joints");
      fixture.cycle->activate();
      fixture.steps(when - 1);
      MultimodeController& modes = fixture.cycle->modes();
      if (stop) {
        modes.stop(ArmSet::of(0));
      } else {
        ASSERT_EQ(fixture.post({.deactivate = bit(modes.find("left_joints"))}), Verdict::accepted);
      }
      fixture.steps(20);
      EXPECT_EQ(modes.owner(0), modes.find("left_hold")) << when << stop;
      EXPECT_TRUE(fixture.runs("right_pose"));
      ASSERT_TRUE(fixture.relayed());
      EXPECT_EQ(fixture.starts("left_joints"), before) << when << stop;
      if (!stop) continue;
      // Resuming alone starts nothing. Neither does the next activation while the stop is in force, nor after
      // it was lifted.
      ASSERT_EQ(fixture.post({.kind = Request::Kind::resume, .arms = ArmSet::of(0)}), Verdict::accepted);
      fixture.steps(20);
      EXPECT_EQ(modes.owner(0), modes.find("left_hold"));
      modes.stop(ArmSet::of(0));
      fixture.step();
      fixture.cycle->deactivate();
      fixture.cycle->activate();
      fixture.steps(2);
      ASSERT_EQ(fixture.post({.kind = Request::Kind::resume, .arms = ArmSet::of(0)}), Verdict::accepted);
      fixture.steps(20);
      EXPECT_EQ(modes.owner(0), modes.find("left_hold"));
      EXPECT_TRUE(fixture.runs("right_pose"));
      fixture.cycle->deactivate();  // the next activation is an ordinary one
      fixture.cycle->activate();
      EXPECT_TRUE(fixture.start());
    }
  }
}

// An arm whose hardware reports its mode: in the first step it does not take commands.
struct LateArm {
  explicit LateArm(Fixture& fixture) : rig_(fixture) {
    shared.model = &fixture.robots[0].terms;
    shared.state.mode = ArmMode::other;
    fixture.cycle->signals(0).shared = &shared;
  }
  bool steps(int n, double period_s = 0.001) {
    bool any = false;
    for (int i = 0; i < n; ++i) {
      ++shared.state.sequence;
      shared.state.q = rig_.robots[0].q;
      shared.state.dq = shared.state.tau_J_d = joint_constant(7, 0);
      shared.state.tau_J = rig_.robots[0].tau_J;
      rig_.take_in();
      any = rig_.cycle->step(period_s);
    }
    return any;
  }
  SharedArmState shared;

 private:
  Fixture& rig_;
};

TEST(HostedStart, WaitsForALateArmInTheLoopsTime) {
  const double period = 0.01;
  const int timeout = static_cast<int>(std::lround(HostedCycle::kTimeout / period));
  for (const int waits : {1, 5, timeout - 5, timeout + 5}) {
    Fixture fixture;
    LateArm left(fixture);
    fixture.cycle->activate();
    left.steps(waits, period);
    EXPECT_FALSE(fixture.runs("left_joints"));
    EXPECT_EQ(fixture.runs("right_pose"), waits > static_cast<int>(HostedCycle::kSettled));
    left.shared.state.mode = ArmMode::move;
    left.steps(20, period);
    EXPECT_EQ(fixture.runs("left_joints"), waits < timeout) << waits;
    EXPECT_TRUE(fixture.runs("right_pose"));
  }
}

TEST(HostedStart, AnArmLostBeforeItSettledIsNotStarted) {
  Fixture fixture;
  LateArm left(fixture);
  fixture.cycle->activate();
  left.steps(2);
  left.shared.state.mode = ArmMode::move;
  left.steps(1);
  left.shared.state.mode = ArmMode::reflex;
  left.steps(1);
  left.shared.state.mode = ArmMode::move;
  left.steps(50);
  EXPECT_FALSE(fixture.runs("left_joints"));
  ASSERT_EQ(fixture.activate("left_joints"), Verdict::accepted);  // a request activates it
  left.steps(1);
  EXPECT_TRUE(fixture.runs("left_joints"));
}

// Activated again while an arm has not reported yet: the earlier controllet does not continue from its
// old state.
TEST(HostedStart, AnArmWithoutAStateOfThisActivationIsNotControlled) {
  Fixture fixture;
  fixture.cycle->activate();
  fixture.steps(5);
  fixture.cycle->deactivate();
  fixture.cycle->activate();
  fixture.take_in();
  fixture.cycle->signals(0).position[3] = NAN;
  fixture.cycle->step(0.001);
  EXPECT_FALSE(fixture.runs("left_joints"));
  for (int i = 0; i < 5; ++i) fixture.cycle->step(0.001);
  EXPECT_FALSE(fixture.runs("left_joints"));
  EXPECT_TRUE(fixture.runs("right_pose"));
  fixture.robots[0].q += joint_constant(7, 0.1);  // moved in the meantime
  fixture.robots[0].dq.setZero();
  fixture.take_in();
  fixture.cycle->step(0.001);
  EXPECT_LT((fixture.command(0) - fixture.gravity(0)).lpNorm<Eigen::Infinity>(), 1e-9);
  fixture.steps(kFirstStart);
  EXPECT_TRUE(fixture.runs("left_joints"));
}

}  // namespace
}  // namespace multipanda::hosted_start_test
