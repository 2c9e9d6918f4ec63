// A motion from its first command to its end: missed and invalid commands, ends, planned motion.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "backends/simulated_arm/internal_controllers.hpp"
#include "backends/simulated_arm/testing/motion_rig.hpp"
#include "core/rt/guard/loop_guard.hpp"

namespace multipanda::motion_life_test {
namespace {

using namespace test;
using testing::ElementsAre;
constexpr double dt = 0.001;

TEST(DesiredMotion, MissedCommandsContinueWithTheLastAcceleration) {
  Arm arm("fr3");
  DesiredMotion& motion = arm.begin(MotionGenerator::joint_velocity);
  JointVector dq = JointVector::Zero(7);
  for (int k = 1; k <= 20; ++k) {
    dq[0] += 4 * std::min(1.0, k / 10.0) * dt;
    const InterfaceCommand command = velocities(dq);
    ASSERT_EQ(motion.step(&command), MotionStep::moving);
  }
  const double q0 = motion.state().q[0];
  for (int k = 0; k < 10; ++k) ASSERT_EQ(motion.step(nullptr), MotionStep::moving);
  EXPECT_NEAR(motion.state().dq[0], dq[0] + 10 * 4 * dt, 1e-9);
  EXPECT_NEAR(motion.state().q[0], q0 + 10 * dq[0] * dt + 4 * dt * dt * 55, 1e-9);  // 1 + ... + 10 = 55
  EXPECT_NEAR(motion.state().ddq[0], 4, 1e-6);
  // And too many of them run into the velocity's limit.
  MotionStep step = MotionStep::moving;
  int more = 0;
  for (; step == MotionStep::moving && more < 2000; ++more) step = motion.step(nullptr);
  EXPECT_EQ(step, MotionStep::violation);
  EXPECT_EQ(motion.violations()[0].error, ArmError::joint_motion_generator_velocity_limits_violation);

  DesiredMotion& pose_motion = arm.begin(MotionGenerator::cartesian_velocity);
  Vector6 V = Vector6::Zero(), A;
  A << 0.3, -0.2, 0.1, 0.2, 0.1, -0.3;
  for (int k = 1; k <= 20; ++k) {
    V += A * std::min(1.0, k / 10.0) * dt;
    const InterfaceCommand command = twist(V);
    ASSERT_EQ(pose_motion.step(&command), MotionStep::moving);
  }
  const Vector3 p0 = pose_motion.state().X_BE_c.position;
  for (int k = 0; k < 10; ++k) ASSERT_EQ(pose_motion.step(nullptr), MotionStep::moving);
  EXPECT_LT((pose_motion.state().V_BE_c.vector - V - 10 * A * dt).norm(), 1e-9);
  EXPECT_LT(
      (pose_motion.state().X_BE_c.position - p0 - 10 * V.head<3>() * dt - A.head<3>() * dt * dt * 55).norm(),
      1e-9);
  EXPECT_LT(pose_error(pose_motion.state().X_BE_c, pose_motion.state().X_BE_d).norm(), 1e-9);
}

TEST(DesiredMotion, EndsAtRestOrReportsThatItStillMoves) {
  Arm arm("fr3");
  InterfaceCommand finished;
  finished.motion_finished = true;
  for (const MotionGenerator generator :
       {MotionGenerator::joint_position, MotionGenerator::joint_velocity, MotionGenerator::cartesian_pose,
        MotionGenerator::cartesian_velocity}) {
    DesiredMotion& motion = arm.begin(generator);
    const JointVector q = motion.state().q;
    finished.q_c = finished.dq_c = JointVector::Zero(7);  // whatever accompanies the flag
    finished.O_T_EE_c = pose({}).O_T_EE_c;
    EXPECT_EQ(motion.step(&finished), MotionStep::at_rest);
    EXPECT_LT((motion.state().q - q).norm(), 1e-9);
  }
  for (const double v : {0.009, 0.02}) {  // the former can stop within a period: 10 rad/s^2
    DesiredMotion& motion = arm.begin(MotionGenerator::joint_velocity);
    for (int k = 1; k <= 40; ++k) {
      const InterfaceCommand command = velocities(JointVector::Constant(7, v * std::min(1.0, k / 20.0)));
      ASSERT_EQ(motion.step(&command), MotionStep::moving);
    }
    finished.dq_c = JointVector::Constant(7, v);
    EXPECT_EQ(motion.step(&finished), v < 0.01 ? MotionStep::at_rest : MotionStep::still_moving);
  }
  DesiredMotion& torque = arm.begin(MotionGenerator::none);
  InterfaceCommand command;
  EXPECT_EQ(torque.step(&command), MotionStep::moving);
  command.torque_finished = true;
  EXPECT_EQ(torque.step(&command), MotionStep::at_rest);
  EXPECT_EQ(torque.start({.generator = MotionGenerator::idle}), MotionStart::invalid_argument);
}

TEST(DesiredMotion, RefusesInvalidCommands) {
  Arm arm("fr3");
  DesiredMotion& motion = arm.begin(MotionGenerator::joint_position);
  const DesiredState before = motion.state();
  JointVector q = before.q;
  q[3] = std::nan("");
  for (const InterfaceCommand& c : {positions(q), positions(JointVector::Zero(6)), InterfaceCommand{}}) {
    EXPECT_EQ(motion.step(&c), MotionStep::input_error);
    EXPECT_EQ(motion.state().q, before.q);
  }
}

TEST(DesiredMotion, PlansAsynchronousMotionItself) {
  Arm arm("fr3");
  DesiredMotion& motion = *arm.motion;
  MotionRequest request{.controller = ArmController::joint_impedance,
                        .generator = MotionGenerator::joint_position,
                        .asynchronous = true,
                        .dq_max = JointVector::Constant(7, 1)};
  motion.hold(arm.model->q_home(), {});
  ASSERT_EQ(motion.start(request), MotionStart::started);
  const JointVector target = motion.state().q + JointVector::Constant(7, 0.25);
  const InterfaceCommand command = positions(target);
  EXPECT_EQ(motion.step(&command), MotionStep::moving);
  int steps = 1;
  for (; steps < 3000 && (motion.state().q - target).norm() >= 1e-3; ++steps) {
    ASSERT_EQ(motion.step(nullptr), MotionStep::moving);
  }
  EXPECT_NEAR(steps * dt, 0.25 / 1 + 1.0 / 10 + 10.0 / 5000, 0.05);
  JointVector outside = target;
  outside[1] = 2;
  EXPECT_THAT(errors_after(motion, positions(outside)),
              ElementsAre(ArmError::joint_position_limits_violation));
  // Finished in motion: it brakes first.
  const InterfaceCommand back = positions(arm.model->q_home());
  motion.step(&back);
  for (int k = 0; k < 150; ++k) motion.step(nullptr);
  const double v = motion.state().dq.lpNorm<Eigen::Infinity>();
  EXPECT_GT(v, 0.5);
  InterfaceCommand stop;
  stop.motion_finished = true;
  MotionStep step = motion.step(&stop);
  for (steps = 0; step == MotionStep::moving && steps < 1000; ++steps) step = motion.step(&stop);
  EXPECT_EQ(step, MotionStep::at_rest);
  EXPECT_NEAR(steps * dt, v / 10 + 10.0 / 5000, 0.01);

  request.dq_max[2] = 0;
  EXPECT_EQ(motion.start(request), MotionStart::invalid_argument);
  request.dq_max = JointVector::Constant(6, 1);
  EXPECT_EQ(motion.start(request), MotionStart::invalid_argument);
  request.dq_max = JointVector::Constant(7, 1);
  request.generator = MotionGenerator::joint_velocity;
  EXPECT_EQ(motion.start(request), MotionStart::invalid_argument);
}

TEST(DesiredMotion, DoesNotAllocate) {
  if (!kLoopGuardWorks) GTEST_SKIP() << "a sanitizer has replaced malloc";
  Arm arm("fr3");
  ModelTerms terms(arm.model);
  InternalControllers controllers(7);
  Vector6 K;
  K << 3000, 3000, 3000, 300, 300, 300;
  std::uint64_t heap_calls = 0, lock_calls = 0;
  for (const bool asynchronous : {false, true}) {
    for (const MotionGenerator generator :
         {MotionGenerator::joint_position, MotionGenerator::cartesian_pose}) {
      if (asynchronous && generator != MotionGenerator::joint_position) continue;
      InterfaceCommand command = pose(arm.motion->state().X_BE_c);
      command.q_c = arm.model->q_home();
      const MotionRequest request{
          .generator = generator, .asynchronous = asynchronous, .dq_max = JointVector::Constant(7, 1)};
      LoopGuard::arm();
      arm.motion->hold(arm.model->q_home(), {});
      arm.motion->start(request);
      for (int k = 0; k < 5; ++k) {
        if (asynchronous) command.q_c[0] += 0.1;
        arm.motion->step(k == 3 ? nullptr : &command);
        const DesiredState& d = arm.motion->state();
        terms.update(d.q, d.dq);
        controllers.joint_impedance(terms, d.q, d.dq, d.ddq, joint_constant(7, 3000));
        controllers.cartesian_impedance(terms, {}, d.X_BE_d, d.V_BE_d, d.A_BE_d, d.q, d.dq, K);
      }
      const LoopGuardCounts counts = LoopGuard::disarm();
      heap_calls += counts.heap_calls;
      lock_calls += counts.lock_calls;
    }
  }
  EXPECT_EQ(heap_calls, 0u);
  EXPECT_EQ(lock_calls, 0u);
}

}  // namespace
}  // namespace multipanda::motion_life_test
