// A cycle in another program's loop, on robots that offer only position, velocity and effort.
#include "runtime/embedded/hosted_cycle.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/rt/guard/loop_guard.hpp"
#include "runtime/embedded/testing/signal_fixture.hpp"

namespace multipanda::hosted_cycle_test {
namespace {

using test::builtins;
using test::eventually;
using test::Fixture;
using test::Gravity;
using test::kJoints;
using test::scene_of;
using testing::HasSubstr;

TEST(HostedCycle, HoldsAndControlsRobotsWithAndWithoutTheirOwnGravityCompensation) {
  for (const bool effort : {true, false}) {
    Fixture fixture(kJoints, effort);
    const JointVector start[2] = {fixture.robots[0].q, fixture.robots[1].q};
    fixture.cycle->activate();
    ASSERT_TRUE(fixture.start());
    for (int i = 0; i < 500; ++i) ASSERT_TRUE(fixture.step());
    for (ArmIndex i = 0; i < 2; ++i) {  // held where it was measured, whichever side compensates gravity
      EXPECT_LT((fixture.robots[i].q - start[i]).lpNorm<Eigen::Infinity>(), 2e-4) << i << effort;
    }
    // A goal is reached, according to the joints.
    Instance& joints = fixture.cycle->modes().instance(fixture.cycle->modes().find("left_joints"));
    Target target;
    target.size = 7;
    const JointVector goal = start[0] + joint_constant(7, 0.1);
    std::copy(goal.begin(), goal.end(), target.values.begin());
    ASSERT_EQ(joints.inputs()[0].post(target), Verdict::accepted);
    for (int i = 0; i < 3000; ++i) fixture.step();
    EXPECT_LT((fixture.robots[0].q - goal).lpNorm<Eigen::Infinity>(), 1e-3) << effort;
    EXPECT_TRUE(fixture.runs("right_pose"));
    // At rest the external torque is zero up to integration errors.
    const ArmState& state = fixture.cycle->data().state[0];
    EXPECT_LT(state.tau_ext_hat.lpNorm<Eigen::Infinity>(), 0.05) << effort;
  }
}

TEST(HostedCycle, RefusesAmbiguousParameters) {
  Fixture fixture(kJoints, true, {Gravity::unspecified, Gravity::robot});
  EXPECT_THAT(fixture.cycle->check(), HasSubstr("arms.left.gravity_compensation"));
  Fixture silent;
  EXPECT_EQ(silent.cycle->check(), "");
  silent.cycle->signals(1).velocity[3] = NAN;
  EXPECT_THAT(silent.cycle->check(), HasSubstr("right_joint4"));
  HostedOptions options;
  options.arms = {{.name = "left", .joints = {"a", "b"}}, {.name = "right"}};
  EXPECT_THROW(HostedCycle(scene_of(kJoints), builtins(), options), std::invalid_argument);
  options.arms = {{.name = "left"}};
  EXPECT_THROW(HostedCycle(scene_of(kJoints), builtins(), options), std::invalid_argument);
}

TEST(HostedCycle, DeactivationLeavesGravityAndActivationStartsFromTheMeasuredState) {
  Fixture fixture;
  fixture.cycle->activate();
  ASSERT_TRUE(fixture.start());
  for (int i = 0; i < 20; ++i) fixture.step();
  for (int round = 0; round < 3; ++round) {
    fixture.take_in();
    fixture.cycle->deactivate();
    EXPECT_LT((fixture.command(0) - fixture.gravity(0)).norm(), 1e-9);
    EXPECT_EQ(fixture.command(1).norm(), 0.0);
    // Another controller moves the arms while the cycle is inactive.
    for (ArmIndex i = 0; i < 2; ++i) {
      fixture.robots[i].q += joint_constant(7, round == 1 ? -0.15 : 0.15);
      fixture.robots[i].dq.setZero();
    }
    const JointVector there[2] = {fixture.robots[0].q, fixture.robots[1].q};
    fixture.take_in();
    fixture.cycle->activate();
    fixture.cycle->step(0.001);
    // The first torque has no contribution of a controllet or of earlier torques.
    EXPECT_FALSE(fixture.runs("left_joints"));
    EXPECT_LT((fixture.command(0) - fixture.gravity(0)).lpNorm<Eigen::Infinity>(), 1e-9);
    EXPECT_EQ(fixture.command(1).norm(), 0.0);
    fixture.move();
    ASSERT_TRUE(fixture.start()) << round;
    for (int i = 0; i < 300; ++i) fixture.step();
    for (ArmIndex i = 0; i < 2; ++i) {
      EXPECT_LT((fixture.robots[i].q - there[i]).lpNorm<Eigen::Infinity>(), 1e-3) << round << i;
    }
  }
}

// Its host's loop stood still (SIGSTOP, swapping) while it was active.
TEST(HostedCycle, AfterAGapOfItsHostAllArmsAreStopped) {
  constexpr auto kPause = GapWatch::kLongest + std::chrono::milliseconds(50);
  Fixture fixture;
  fixture.cycle->activate();
  ASSERT_TRUE(fixture.start());
  fixture.take_in();
  fixture.cycle->deactivate();
  std::this_thread::sleep_for(kPause);
  fixture.take_in();
  fixture.cycle->activate();
  for (int i = 0; i < 5; ++i) fixture.step();
  EXPECT_TRUE(fixture.cycle->modes().stopped().empty()) << "an inactive controller stands still for long";
  EXPECT_TRUE(fixture.runs("right_pose"));
  std::this_thread::sleep_for(kPause);
  fixture.step();
  EXPECT_EQ(fixture.cycle->modes().stopped(), ArmSet::all(2));
  EXPECT_FALSE(fixture.runs("right_pose"));
}

TEST(HostedCycle, SilentJointsGoToHoldThenToNoTorque) {
  Fixture fixture;
  fixture.cycle->activate();
  ASSERT_TRUE(fixture.start());
  fixture.take_in();
  fixture.cycle->signals(0).position[2] = NAN;
  const JointVector before = fixture.command(0);
  for (int i = 0; i < 15; ++i) fixture.cycle->step(0.001);
  EXPECT_EQ(fixture.command(0), before);  // one lost packet does not release the arm
  for (int i = 0; i < 10; ++i) fixture.cycle->step(0.001);
  EXPECT_FALSE(fixture.runs("left_joints"));
  EXPECT_TRUE(fixture.runs("right_pose"));
  fixture.robots[0].terms.update(fixture.robots[0].q, fixture.robots[0].dq);
  EXPECT_LT((fixture.command(0) - fixture.gravity(0)).lpNorm<Eigen::Infinity>(), 1e-2);
}

// While an arm is silent it gets no torque of a controllet; when it returns, it is held where it is then,
// from that torque, not where it was and with the torque it had.
TEST(HostedCycle, AnArmThatReturnsFromSilenceIsHeldWhereItIs) {
  Fixture fixture;
  fixture.cycle->activate();
  ASSERT_TRUE(fixture.start());
  fixture.steps(50);
  fixture.take_in();
  for (const double silence_s : {0.015, 0.5}) {
    fixture.take_in();
    const JointVector q = fixture.robots[0].q;
    fixture.cycle->signals(0).velocity[5] = NAN;
    for (int i = 0; i < silence_s / 0.001; ++i) fixture.cycle->step(0.001);
    if (silence_s < 0.02) {
      EXPECT_EQ(fixture.cycle->data().state[0].mode, ArmMode::move);
      EXPECT_TRUE(fixture.runs("left_joints"));
      continue;
    }
    EXPECT_EQ(fixture.cycle->data().state[0].mode, ArmMode::disconnected);
    EXPECT_FALSE(fixture.runs("left_joints"));
    fixture.robots[0].q = q + joint_constant(7, 0.2);  // it sank, or was moved
    fixture.robots[0].dq.setZero();
    const JointVector there = fixture.robots[0].q;
    for (int i = 0; i < 300; ++i) {
      fixture.step();
      if (i == 0) {
        EXPECT_EQ(fixture.cycle->data().state[0].mode, ArmMode::move);
        // One step of the torque rate at most, from gravity alone; held 0.2 rad away, it would be many.
        EXPECT_LE((fixture.command(0) - fixture.gravity(0)).lpNorm<Eigen::Infinity>(), 1.5);
      }
      ASSERT_LT((fixture.robots[0].q - there).lpNorm<Eigen::Infinity>(), 0.01) << i;
    }
    EXPECT_EQ(fixture.activate("left_joints"), Verdict::accepted);
    fixture.step();
    EXPECT_TRUE(fixture.runs("left_joints"));
  }
}

// Hardware whose driver has stopped goes on delivering its last numbers.
TEST(HostedCycle, FrozenNumbersCountAsSilence) {
  Fixture fixture;
  fixture.cycle->activate();
  ASSERT_TRUE(fixture.start());
  fixture.steps(50);
  const auto mode = [&] { return fixture.cycle->data().state[0].mode; };
  // At rest an arm may repeat its numbers for as long as it likes.
  fixture.robots[0].dq.setZero();
  fixture.take_in();
  for (int i = 0; i < 200; ++i) fixture.cycle->step(0.001);
  EXPECT_EQ(mode(), ArmMode::move);
  EXPECT_TRUE(fixture.runs("left_joints"));
  // Not while its torque follows a goal.
  Instance& joints = fixture.cycle->modes().instance(fixture.cycle->modes().find("left_joints"));
  Target target;
  target.size = 7;
  const JointVector goal = fixture.robots[0].q + joint_constant(7, 0.5);
  std::copy(goal.begin(), goal.end(), target.values.begin());
  ASSERT_EQ(joints.inputs()[0].post(target), Verdict::accepted);
  int steps = 0;
  while (mode() == ArmMode::move && ++steps < 1000) fixture.cycle->step(0.001);
  EXPECT_LT(steps, 1000);
  fixture.cycle->step(0.001);
  EXPECT_EQ(mode(), ArmMode::disconnected);
  EXPECT_FALSE(fixture.runs("left_joints"));
  EXPECT_LT((fixture.command(0) - fixture.gravity(0)).norm(), 1e-9);
  fixture.robots[0].dq[1] = 1e-3;
  fixture.steps(5);  // its numbers change again
  EXPECT_EQ(mode(), ArmMode::move);
  // Nor while it says that it moves: 20 ms, then a step.
  fixture.steps(100);
  fixture.robots[0].dq[2] = 0.3;
  fixture.take_in();
  fixture.cycle->step(0.001);
  for (int i = 0; i < 19; ++i) fixture.cycle->step(0.001);
  EXPECT_EQ(mode(), ArmMode::move);
  for (int i = 0; i < 3; ++i) fixture.cycle->step(0.001);
  EXPECT_EQ(mode(), ArmMode::disconnected);
}

TEST(HostedCycle, KeepsLoadsAndFramesAndRefusesOtherRequests) {
  Fixture fixture;
  fixture.cycle->activate();
  ASSERT_TRUE(fixture.start());
  const auto gravity = [&] { return JointVector(fixture.command(0) - fixture.cycle->data().tau_cmd[0]); };
  const JointVector before = gravity();
  Load load;
  load.mass = 2;
  load.p_FC = {0.1, 0, 0.1};
  ASSERT_TRUE(fixture.cycle->backend().request(0, SetLoad{load}).get().success);
  fixture.step();
  EXPECT_EQ(fixture.cycle->data().state[0].load.mass, 2);
  EXPECT_LT((gravity() - before).norm(), 0.05);  // its weight comes in within a second
  fixture.steps(499);
  const double half = (gravity() - before).norm();
  fixture.steps(500);
  EXPECT_GT((gravity() - before).norm(), 1.0);
  EXPECT_NEAR((gravity() - before).norm(), 2 * half, 0.05 * half);
  EXPECT_FALSE(fixture.cycle->backend().request(0, RecoverFromError{}).get().success);
  EXPECT_FALSE(fixture.cycle->backend().request(9, SetLoad{load}).get().success);
  load.mass = -1;
  EXPECT_FALSE(fixture.cycle->backend().request(0, SetLoad{load}).get().success);
}

TEST(HostedCycle, TheAdapterGetsEveryRecordInOrder) {
  Fixture fixture;
  fixture.cycle->activate();
  ASSERT_TRUE(fixture.start());
  const std::uint64_t cycles = fixture.cycle->data().tick.cycle;
  ASSERT_TRUE(eventually([&] {
    const std::lock_guard lock(fixture.counting->mutex);
    return fixture.counting->cycles.size() == cycles;
  }));
  for (std::size_t i = 0; i < cycles; ++i) ASSERT_EQ(fixture.counting->cycles[i], i + 1);
  EXPECT_THAT(fixture.counting->events, testing::Contains(testing::Field(&Event::kind, EventKind::arm_mode)));
}

TEST(HostedCycle, AcceptsIrregularPeriods) {
  Fixture fixture;
  fixture.cycle->activate();
  for (const double period : {0.0, -1.0, static_cast<double>(NAN)}) fixture.cycle->step(period);
  EXPECT_NEAR(fixture.cycle->data().tick.t.seconds(), 0.003, 1e-9);
  fixture.cycle->step(0.004);
  EXPECT_NEAR(fixture.cycle->data().tick.dt, 0.004, 1e-9);
  EXPECT_EQ(fixture.cycle->backend().overruns(), 3u);
}

TEST(HostedCycle, NeitherAllocatesNorLocks) {
  if (!kLoopGuardWorks) GTEST_SKIP() << "sanitizers replace malloc themselves";
  Fixture fixture;
  fixture.cycle->activate();
  ASSERT_TRUE(fixture.start());
  LoopGuard::arm();
  for (int round = 0; round < 3; ++round) {
    for (int i = 0; i < 50; ++i) fixture.cycle->step(0.001);
    fixture.cycle->deactivate();
    fixture.cycle->activate();
  }
  const LoopGuardCounts counts = LoopGuard::disarm();
  EXPECT_EQ(counts.heap_calls, 0u);
  EXPECT_EQ(counts.lock_calls, 0u);
}

TEST(SharedArmState, OnlyAStructOfThisBuildIsAccepted) {
  SharedArmState shared;
  EXPECT_EQ(shared_arm_state(to_interface(&shared)), &shared);
  for (const double value :
       {0.0, 1.0, -1.0, static_cast<double>(NAN), static_cast<double>(INFINITY), 1e-300}) {
    EXPECT_EQ(shared_arm_state(value), nullptr) << value;
  }
  EXPECT_EQ(shared_arm_state_refusal(to_interface(&shared)), "");
  EXPECT_EQ(shared_arm_state_refusal(0.0), "");  // none
  shared.size += 8;
  EXPECT_EQ(shared_arm_state(to_interface(&shared)), nullptr);
  EXPECT_THAT(shared_arm_state_refusal(to_interface(&shared)), testing::HasSubstr("other headers"));
  // Headers that differ without changing a size, such as two members in another order.
  shared = SharedArmState{};
  const std::string ours = shared.headers.data();
  EXPECT_EQ(ours.size(), 16u);
  shared.headers[0] = shared.headers[0] == '0' ? '1' : '0';
  EXPECT_EQ(shared_arm_state(to_interface(&shared)), nullptr);
  EXPECT_THAT(shared_arm_state_refusal(to_interface(&shared)),
              testing::AllOf(testing::HasSubstr("(hash " + std::string(shared.headers.data()) + ")"),
                             testing::HasSubstr("than this controller (hash " + ours + ")"),
                             testing::HasSubstr("build multipanda_hardware and multipanda_controller")));
  shared = SharedArmState{};
  shared.layout ^= 1;
  EXPECT_EQ(shared_arm_state(to_interface(&shared)), nullptr);
  EXPECT_THAT(shared_arm_state_refusal(to_interface(&shared)), testing::HasSubstr("type layouts differ"));
  alignas(8) std::array<char, sizeof(SharedArmState)> other{};  // another struct
  EXPECT_EQ(shared_arm_state(to_interface(reinterpret_cast<const SharedArmState*>(other.data()))), nullptr);
}

}  // namespace
}  // namespace multipanda::hosted_cycle_test
