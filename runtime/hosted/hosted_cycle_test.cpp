// A cycle in somebody else's loop, on robots that offer position, velocity and effort and nothing else.
#include "runtime/hosted/hosted_cycle.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/rt/guard/loop_guard.hpp"
#include "runtime/hosted/signal_rig.hpp"

namespace multipanda {
namespace {

using test::builtins;
using test::eventually;
using test::Gravity;
using test::kJoints;
using test::Rig;
using test::scene_of;
using testing::HasSubstr;

TEST(HostedCycle, HoldsAndControlsRobotsWithAndWithoutTheirOwnGravityCompensation) {
  for (const bool effort : {true, false}) {
    Rig rig(kJoints, effort);
    const JointVector start[2] = {rig.robots[0].q, rig.robots[1].q};
    rig.cycle->activate();
    ASSERT_TRUE(rig.start());
    for (int i = 0; i < 500; ++i) ASSERT_TRUE(rig.step());
    for (ArmIndex i = 0; i < 2; ++i) {  // held where it was measured, whoever carries the weight
      EXPECT_LT((rig.robots[i].q - start[i]).lpNorm<Eigen::Infinity>(), 2e-4) << i << effort;
    }
    // A goal, reached: left by its joints.
    Instance& joints = rig.cycle->modes().instance(rig.cycle->modes().find("left_joints"));
    Target target;
    target.size = 7;
    const JointVector goal = start[0] + joint_constant(7, 0.1);
    std::copy(goal.begin(), goal.end(), target.values.begin());
    ASSERT_EQ(joints.inputs()[0].post(target), Verdict::accepted);
    for (int i = 0; i < 3000; ++i) rig.step();
    EXPECT_LT((rig.robots[0].q - goal).lpNorm<Eigen::Infinity>(), 1e-3) << effort;
    EXPECT_TRUE(rig.runs("right_pose"));
    // At rest the external torque is zero within what the integration leaves.
    const ArmState& state = rig.cycle->data().state[0];
    EXPECT_LT(state.tau_ext_hat.lpNorm<Eigen::Infinity>(), 0.05) << effort;
  }
}

TEST(HostedCycle, RefusesWhatIsUnclear) {
  Rig rig(kJoints, true, {Gravity::unsaid, Gravity::robot});
  EXPECT_THAT(rig.cycle->check(), HasSubstr("arms.left.gravity_compensation"));
  Rig silent;
  EXPECT_EQ(silent.cycle->check(), "");
  silent.cycle->signals(1).velocity[3] = NAN;
  EXPECT_THAT(silent.cycle->check(), HasSubstr("right_joint4"));
  HostedOptions options;
  options.arms = {{.name = "left", .joints = {"a", "b"}}, {.name = "right"}};
  EXPECT_THROW(HostedCycle(scene_of(kJoints), builtins(), options), std::invalid_argument);
  options.arms = {{.name = "left"}};
  EXPECT_THROW(HostedCycle(scene_of(kJoints), builtins(), options), std::invalid_argument);
}

TEST(HostedCycle, LeavesGravityAloneAndComesBackFromTheMeasuredState) {
  Rig rig;
  rig.cycle->activate();
  ASSERT_TRUE(rig.start());
  for (int i = 0; i < 20; ++i) rig.step();
  for (int round = 0; round < 3; ++round) {
    rig.take_in();
    rig.cycle->deactivate();
    EXPECT_LT((rig.command(0) - rig.gravity(0)).norm(), 1e-9);
    EXPECT_EQ(rig.command(1).norm(), 0.0);
    // Somebody else moves the arms; the cycle sees nothing of it.
    for (ArmIndex i = 0; i < 2; ++i) {
      rig.robots[i].q += joint_constant(7, round == 1 ? -0.15 : 0.15);
      rig.robots[i].dq.setZero();
    }
    const JointVector there[2] = {rig.robots[0].q, rig.robots[1].q};
    rig.take_in();
    rig.cycle->activate();
    rig.cycle->step(0.001);
    // The first torque: no controllet, nothing of the torque of before.
    EXPECT_FALSE(rig.runs("left_joints"));
    EXPECT_LT((rig.command(0) - rig.gravity(0)).lpNorm<Eigen::Infinity>(), 1e-9);
    EXPECT_EQ(rig.command(1).norm(), 0.0);
    rig.move();
    ASSERT_TRUE(rig.start()) << round;
    for (int i = 0; i < 300; ++i) rig.step();
    for (ArmIndex i = 0; i < 2; ++i) {
      EXPECT_LT((rig.robots[i].q - there[i]).lpNorm<Eigen::Infinity>(), 1e-3) << round << i;
    }
  }
}

TEST(HostedCycle, SilentJointsGoToHoldThenToNoTorque) {
  Rig rig;
  rig.cycle->activate();
  ASSERT_TRUE(rig.start());
  rig.take_in();
  rig.cycle->signals(0).position[2] = NAN;
  const JointVector before = rig.command(0);
  for (int i = 0; i < 15; ++i) rig.cycle->step(0.001);
  EXPECT_EQ(rig.command(0), before);  // a packet lost is no reason to let go
  for (int i = 0; i < 10; ++i) rig.cycle->step(0.001);
  EXPECT_FALSE(rig.runs("left_joints"));
  EXPECT_TRUE(rig.runs("right_pose"));
  rig.robots[0].terms.update(rig.robots[0].q, rig.robots[0].dq);
  EXPECT_LT((rig.command(0) - rig.gravity(0)).lpNorm<Eigen::Infinity>(), 1e-2);
}

TEST(HostedCycle, LoadsAndFramesAreKeptHereOtherRequestsAreRefused) {
  Rig rig;
  rig.cycle->activate();
  ASSERT_TRUE(rig.start());
  const JointVector before = rig.command(0);
  Load load;
  load.mass = 2;
  load.p_FC = {0.1, 0, 0.1};
  ASSERT_TRUE(rig.cycle->backend().request(0, SetLoad{load}).get().success);
  rig.step();
  EXPECT_GT((rig.command(0) - before).norm(), 1.0);  // its weight is carried from the next step on
  EXPECT_EQ(rig.cycle->data().state[0].load.mass, 2);
  EXPECT_FALSE(rig.cycle->backend().request(0, RecoverFromError{}).get().success);
  EXPECT_FALSE(rig.cycle->backend().request(9, SetLoad{load}).get().success);
  load.mass = -1;
  EXPECT_FALSE(rig.cycle->backend().request(0, SetLoad{load}).get().success);
}

TEST(HostedCycle, TheAdapterGetsEveryRecordInOrder) {
  Rig rig;
  rig.cycle->activate();
  ASSERT_TRUE(rig.start());
  const std::uint64_t cycles = rig.cycle->data().tick.cycle;
  ASSERT_TRUE(eventually([&] {
    const std::lock_guard lock(rig.counting->mutex);
    return rig.counting->cycles.size() == cycles;
  }));
  for (std::size_t i = 0; i < cycles; ++i) ASSERT_EQ(rig.counting->cycles[i], i + 1);
  EXPECT_THAT(rig.counting->events, testing::Contains(testing::Field(&Event::kind, EventKind::arm_mode)));
}

TEST(HostedCycle, OddPeriodsAreTakenAsTheyAre) {
  Rig rig;
  rig.cycle->activate();
  for (const double period : {0.0, -1.0, static_cast<double>(NAN)}) rig.cycle->step(period);
  EXPECT_NEAR(rig.cycle->data().tick.t.seconds(), 0.003, 1e-9);
  rig.cycle->step(0.004);
  EXPECT_NEAR(rig.cycle->data().tick.dt, 0.004, 1e-9);
  EXPECT_EQ(rig.cycle->backend().overruns(), 3u);
}

TEST(HostedCycle, NeitherAllocatesNorLocks) {
  if (!kLoopGuardWorks) GTEST_SKIP() << "sanitizers replace malloc themselves";
  Rig rig;
  rig.cycle->activate();
  ASSERT_TRUE(rig.start());
  LoopGuard::arm();
  for (int round = 0; round < 3; ++round) {
    for (int i = 0; i < 50; ++i) rig.cycle->step(0.001);
    rig.cycle->deactivate();
    rig.cycle->activate();
  }
  const LoopGuardCounts counts = LoopGuard::disarm();
  EXPECT_EQ(counts.heap_calls, 0u);
  EXPECT_EQ(counts.lock_calls, 0u);
}

TEST(ArmWindow, OnlyAWindowOfThisBuildIsLookedThrough) {
  ArmWindow window;
  EXPECT_EQ(window_behind(to_interface(&window)), &window);
  for (const double value :
       {0.0, 1.0, -1.0, static_cast<double>(NAN), static_cast<double>(INFINITY), 1e-300}) {
    EXPECT_EQ(window_behind(value), nullptr) << value;
  }
  window.version = 2;
  EXPECT_EQ(window_behind(to_interface(&window)), nullptr);
  window = ArmWindow{};
  window.size += 8;
  EXPECT_EQ(window_behind(to_interface(&window)), nullptr);
  window = ArmWindow{};
  window.build[0] = 'x';
  EXPECT_EQ(window_behind(to_interface(&window)), nullptr);
  alignas(8) std::array<char, sizeof(ArmWindow)> other{};  // somebody else's struct
  EXPECT_EQ(window_behind(to_interface(reinterpret_cast<const ArmWindow*>(other.data()))), nullptr);
}

}  // namespace
}  // namespace multipanda
