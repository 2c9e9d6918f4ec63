// When the controllets of a hosted cycle's scene start, and what goes before them.
#include <cmath>

#include <gtest/gtest.h>

#include "runtime/hosted/hosted_cycle.hpp"
#include "runtime/hosted/signal_rig.hpp"

namespace multipanda {
namespace {

using test::kFirstStart;
using test::Rig;

// A third that may have the left arm.
const char* const kChoice =
    "controllets:\n"
    "  left_joints: {type: joint_impedance, arms: left}\n"
    "  left_pose: {type: cartesian_impedance, arms: left}\n"
    "  right_pose: {type: cartesian_impedance, arms: right}\n"
    "active: [left_joints, right_pose]\n";

TEST(HostedStart, ControlletsStartInTheFirstStepOfAll) {
  Rig rig;
  rig.cycle->activate();
  rig.step();
  EXPECT_TRUE(rig.runs("left_joints") && rig.runs("right_pose"));
  EXPECT_EQ(rig.cycle->data().tick.cycle, 1u);
}

TEST(HostedStart, LaterTheyStartWhenTheirArmsHaveSettledToTheStep) {
  Rig rig;
  for (int round = 0; round < 3; ++round) {
    const std::lock_guard busy(rig.counting->mutex);  // no other thread has a part in it
    rig.cycle->activate();
    for (int i = 1; i < 6; ++i) {
      rig.step();
      EXPECT_EQ(rig.runs("left_joints"), round == 0 || i >= kFirstStart) << round << " " << i;
      EXPECT_EQ(rig.runs("right_pose"), round == 0 || i >= kFirstStart) << round << " " << i;
    }
    rig.cycle->deactivate();
  }
}

// Where users and the scene differ, users win, however busy the computer is: the relay sees nothing before
// the user's switch was taken.
TEST(HostedStart, AUsersSwitchInTheFirstStepsStands) {
  Rig rig(kChoice);
  {
    const std::lock_guard busy(rig.counting->mutex);
    rig.cycle->activate();
    rig.steps(10);
    ASSERT_EQ(rig.activate("left_pose"), Verdict::accepted);
    rig.step();
    ASSERT_TRUE(rig.runs("left_pose"));
  }
  ASSERT_TRUE(rig.relayed());
  std::this_thread::sleep_for(std::chrono::milliseconds(5));
  rig.steps(50);
  EXPECT_TRUE(rig.runs("left_pose") && rig.runs("right_pose"));
  EXPECT_EQ(rig.starts("left_joints"), 1);  // in the first step
}

// The same at a later activation, with the user's switch taken before, in and after the step in which the
// start is due. Before its arms take commands again a switch is refused, and the scene's start comes.
TEST(HostedStart, AUsersSwitchStandsInWhicheverStepItComes) {
  for (int when = 1; when <= kFirstStart + 1; ++when) {
    Rig rig(kChoice);
    rig.cycle->activate();
    rig.step();
    rig.cycle->deactivate();
    ASSERT_TRUE(rig.relayed());
    const int before = rig.starts("left_joints");
    rig.cycle->activate();
    rig.steps(when - 1);
    ASSERT_EQ(rig.activate("left_pose"), Verdict::accepted);
    rig.steps(20);
    const bool too_soon = when == 1;
    EXPECT_EQ(rig.runs("left_pose"), !too_soon) << when;
    EXPECT_EQ(rig.runs("left_joints"), too_soon) << when;
    EXPECT_TRUE(rig.runs("right_pose")) << when;  // nobody spoke about this arm
    ASSERT_TRUE(rig.relayed());
    // Not even started to be stopped at once.
    EXPECT_EQ(rig.starts("left_joints") - before, when == 1 || when > kFirstStart ? 1 : 0) << when;
  }
}

TEST(HostedStart, WhatAUserSwitchedOffOrStoppedStaysOff) {
  for (int when = 1; when <= kFirstStart; ++when) {
    for (const bool stop : {false, true}) {
      Rig rig;
      rig.cycle->activate();
      rig.step();
      rig.cycle->deactivate();
      ASSERT_TRUE(rig.relayed());
      const int before = rig.starts("left_joints");
      rig.cycle->activate();
      rig.steps(when - 1);
      MultimodeController& modes = rig.cycle->modes();
      if (stop) {
        modes.stop(ArmSet::of(0));
      } else {
        ASSERT_EQ(rig.post({.deactivate = bit(modes.find("left_joints"))}), Verdict::accepted);
      }
      rig.steps(20);
      EXPECT_EQ(modes.owner(0), modes.find("left_hold")) << when << stop;
      EXPECT_TRUE(rig.runs("right_pose"));
      ASSERT_TRUE(rig.relayed());
      EXPECT_EQ(rig.starts("left_joints"), before) << when << stop;
      if (!stop) continue;
      // Resuming starts nothing by itself. Neither does the next activation while the stop is in force, nor
      // after it was lifted.
      ASSERT_EQ(rig.post({.kind = Request::Kind::resume, .arms = ArmSet::of(0)}), Verdict::accepted);
      rig.steps(20);
      EXPECT_EQ(modes.owner(0), modes.find("left_hold"));
      modes.stop(ArmSet::of(0));
      rig.step();
      rig.cycle->deactivate();
      rig.cycle->activate();
      rig.steps(2);
      ASSERT_EQ(rig.post({.kind = Request::Kind::resume, .arms = ArmSet::of(0)}), Verdict::accepted);
      rig.steps(20);
      EXPECT_EQ(modes.owner(0), modes.find("left_hold"));
      EXPECT_TRUE(rig.runs("right_pose"));
      rig.cycle->deactivate();  // and the one after it is as any other
      rig.cycle->activate();
      EXPECT_TRUE(rig.start());
    }
  }
}

// An arm whose hardware says its mode: in the first step it does not take commands.
struct LateArm {
  explicit LateArm(Rig& rig) : rig_(rig) {
    window.model = &rig.robots[0].terms;
    window.state.mode = ArmMode::other;
    rig.cycle->signals(0).window = &window;
  }
  bool steps(int n, double period_s = 0.001) {
    bool any = false;
    for (int i = 0; i < n; ++i) {
      ++window.state.sequence;
      window.state.q = rig_.robots[0].q;
      window.state.dq = window.state.tau_J_d = joint_constant(7, 0);
      window.state.tau_J = rig_.robots[0].tau_J;
      rig_.take_in();
      any = rig_.cycle->step(period_s);
    }
    return any;
  }
  ArmWindow window;

 private:
  Rig& rig_;
};

TEST(HostedStart, AnArmThatIsLateIsWaitedForInTheLoopsTime) {
  const double period = 0.01;
  const int patience = static_cast<int>(std::lround(HostedCycle::kPatience / period));
  for (const int waits : {1, 5, patience - 5, patience + 5}) {
    Rig rig;
    LateArm left(rig);
    rig.cycle->activate();
    left.steps(waits, period);
    EXPECT_FALSE(rig.runs("left_joints"));
    EXPECT_EQ(rig.runs("right_pose"), waits > static_cast<int>(HostedCycle::kSettled));
    left.window.state.mode = ArmMode::move;
    left.steps(20, period);
    EXPECT_EQ(rig.runs("left_joints"), waits < patience) << waits;
    EXPECT_TRUE(rig.runs("right_pose"));
  }
}

TEST(HostedStart, AnArmThatIsLostBeforeItSettledIsNotStartedByItself) {
  Rig rig;
  LateArm left(rig);
  rig.cycle->activate();
  left.steps(2);
  left.window.state.mode = ArmMode::move;
  left.steps(1);
  left.window.state.mode = ArmMode::reflex;
  left.steps(1);
  left.window.state.mode = ArmMode::move;
  left.steps(50);
  EXPECT_FALSE(rig.runs("left_joints"));
  ASSERT_EQ(rig.activate("left_joints"), Verdict::accepted);  // who asks gets it
  left.steps(1);
  EXPECT_TRUE(rig.runs("left_joints"));
}

// Activated again, an arm that says nothing yet: what ran before does not go on with what it knew.
TEST(HostedStart, AnArmWithoutAStateOfThisActivationIsNotControlled) {
  Rig rig;
  rig.cycle->activate();
  rig.steps(5);
  rig.cycle->deactivate();
  rig.cycle->activate();
  rig.take_in();
  rig.cycle->signals(0).position[3] = NAN;
  rig.cycle->step(0.001);
  EXPECT_FALSE(rig.runs("left_joints"));
  for (int i = 0; i < 5; ++i) rig.cycle->step(0.001);
  EXPECT_FALSE(rig.runs("left_joints"));
  EXPECT_TRUE(rig.runs("right_pose"));
  rig.robots[0].q += joint_constant(7, 0.1);  // moved by somebody meanwhile
  rig.robots[0].dq.setZero();
  rig.take_in();
  rig.cycle->step(0.001);
  EXPECT_LT((rig.command(0) - rig.gravity(0)).lpNorm<Eigen::Infinity>(), 1e-9);
  rig.steps(kFirstStart);
  EXPECT_TRUE(rig.runs("left_joints"));
}

}  // namespace
}  // namespace multipanda
