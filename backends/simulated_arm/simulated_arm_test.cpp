// Modes and motions of the simulated arm, on a plant of rigid bodies.
#include <gtest/gtest.h>

#include "backends/simulated_arm/testing/arm_rig.hpp"
#include "core/rt/guard/loop_guard.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::simulated_arm_test {
namespace {

using test::ArmRig;
using test::Draw;

const MotionRequest kTorqueOnly{};
MotionRequest request(ArmController controller, MotionGenerator generator) {
  return {.controller = controller, .generator = generator, .asynchronous = false, .dq_max = {}};
}

// A smooth step of height 1 over T: value and velocity.
double smooth(double t, double T) {
  const double s = std::clamp(t / T, 0.0, 1.0);
  return s * s * s * (10 - 15 * s + 6 * s * s);
}

TEST(Motions, ModesChangeTogetherWithTheNextState) {
  ArmRig rig("fr3", Draw(1).pose(1));
  EXPECT_EQ(rig.face().mode, ArmMode::idle);
  EXPECT_EQ(rig.face().generator, MotionGenerator::idle);
  EXPECT_EQ(rig.face().controller, ArmController::other);
  ASSERT_EQ(rig.arm.start_motion(kTorqueOnly), MotionStart::started);
  EXPECT_EQ(rig.face().mode, ArmMode::idle) << "not before the next state";
  rig.step();
  EXPECT_EQ(rig.face().mode, ArmMode::move);
  EXPECT_EQ(rig.state().mode, ArmMode::move);
  EXPECT_EQ(rig.face().generator, MotionGenerator::none);
  EXPECT_EQ(rig.face().controller, ArmController::external);
  EXPECT_EQ(rig.arm.start_motion(kTorqueOnly), MotionStart::not_possible);
  rig.command({.tau_J_d = rig.zero()});
  EXPECT_EQ(rig.face().command_success_rate, 1);
  rig.command({.tau_J_d = rig.zero(), .torque_finished = true});
  EXPECT_EQ(rig.face().mode, ArmMode::idle);
  EXPECT_EQ(rig.face().generator, MotionGenerator::idle);
  EXPECT_EQ(rig.face().command_success_rate, 0);
  EXPECT_EQ(rig.arm.motions_ended(), 1u);
  EXPECT_EQ(rig.arm.motion_end(), MotionEnd::finished);
  ASSERT_EQ(rig.arm.start_motion(kTorqueOnly), MotionStart::started);
  rig.command({.tau_J_d = rig.zero()});
  rig.arm.stop_motion();
  EXPECT_EQ(rig.arm.motion_end(), MotionEnd::preempted);
  EXPECT_EQ(rig.arm.motions_ended(), 2u);
  rig.arm.stop_motion();
  EXPECT_EQ(rig.arm.motions_ended(), 2u) << "nothing ran";
  rig.step();
  EXPECT_EQ(rig.face().mode, ArmMode::idle);
}

TEST(Motions, CombinationsThatDoNotExistAreRefused) {
  ArmRig rig("fer");
  using C = ArmController;
  using G = MotionGenerator;
  EXPECT_EQ(rig.arm.start_motion(request(C::joint_impedance, G::none)), MotionStart::invalid_argument);
  EXPECT_EQ(rig.arm.start_motion(request(C::other, G::joint_position)), MotionStart::invalid_argument);
  EXPECT_EQ(rig.arm.start_motion(request(C::external, G::idle)), MotionStart::invalid_argument);
  MotionRequest planned = request(C::joint_impedance, G::joint_position);
  planned.asynchronous = true;
  planned.dq_max = joint_constant(7, std::nan(""));
  EXPECT_EQ(rig.arm.start_motion(planned), MotionStart::invalid_argument);
  EXPECT_EQ(rig.arm.mode(), ArmMode::idle);
}

TEST(Motions, LossesCountFromTheFirstCommand) {
  ArmRig rig("fer");
  ASSERT_EQ(rig.arm.start_motion(kTorqueOnly), MotionStart::started);
  for (int k = 0; k < 50; ++k) {
    rig.arm.miss_command();
    rig.step();
  }
  EXPECT_EQ(rig.face().mode, ArmMode::move);
  EXPECT_EQ(rig.face().command_success_rate, 0);
  JointVector tau = rig.zero();
  tau[0] = 0.7;
  for (int k = 0; k < 100; ++k) rig.command({.tau_J_d = tau});
  for (int k = 1; k < SimulatedArm::kLostCommands; ++k) {
    rig.arm.miss_command();
    rig.step();
    EXPECT_EQ(rig.state().tau_J_d[0], 0.7) << "held";
    EXPECT_NEAR(rig.face().command_success_rate, (100 - k) / 100.0, 1e-12);
  }
  rig.command({.tau_J_d = tau});
  EXPECT_EQ(rig.face().mode, ArmMode::move) << "in a row";
  for (int k = 0; k < SimulatedArm::kLostCommands; ++k) {
    ASSERT_EQ(rig.arm.mode(), ArmMode::move);
    rig.arm.miss_command();
    rig.step();
  }
  EXPECT_EQ(rig.face().mode, ArmMode::reflex);
  EXPECT_EQ(rig.face().errors, error_bit(ArmError::communication_constraints_violation));
  EXPECT_EQ(rig.face().reflex_reason, rig.face().errors);
  EXPECT_EQ(rig.arm.reflex_detail().error, ArmError::communication_constraints_violation);
  EXPECT_EQ(rig.arm.reflex_detail().value, 20);
  EXPECT_EQ(rig.arm.motion_end(), MotionEnd::reflex);
}

TEST(Motions, RecoveryIsForErrorsAndNotInAUserStop) {
  ArmRig rig("fr3", Draw(4).pose(1));
  EXPECT_EQ(rig.arm.apply(RecoverFromError{}), ArmReply::nothing_to_recover);
  rig.arm.start_motion(kTorqueOnly);
  rig.command({.tau_J_d = rig.zero()});
  rig.arm.raise(ArmError::instability_detected);
  rig.step();
  EXPECT_EQ(rig.face().mode, ArmMode::reflex);
  EXPECT_EQ(rig.arm.start_motion(kTorqueOnly), MotionStart::not_possible);
  EXPECT_EQ(rig.arm.apply(SetUserStop{true}), ArmReply::done);
  EXPECT_EQ(rig.face().mode, ArmMode::user_stopped);
  EXPECT_EQ(rig.arm.apply(RecoverFromError{}), ArmReply::user_stop_pressed);
  EXPECT_EQ(rig.arm.apply(SetUserStop{false}), ArmReply::done);
  EXPECT_EQ(rig.face().mode, ArmMode::reflex) << "the error is still there";
  EXPECT_EQ(rig.arm.apply(RecoverFromError{}), ArmReply::done);
  rig.step();
  EXPECT_EQ(rig.face().mode, ArmMode::idle);
  EXPECT_EQ(rig.face().errors, 0u);
  EXPECT_EQ(rig.face().reflex_reason, error_bit(ArmError::instability_detected)) << "until the next motion";
  rig.arm.start_motion(kTorqueOnly);
  rig.step();
  EXPECT_EQ(rig.face().reflex_reason, 0u);
  rig.arm.apply(SetUserStop{true});
  EXPECT_EQ(rig.arm.motion_end(), MotionEnd::user_stop);
  EXPECT_EQ(rig.arm.start_motion(kTorqueOnly), MotionStart::not_possible);
}

// Braking: at rest within the motors' limits, then held; the arm yields to a push and returns.
TEST(Motions, WhatEndsAMotionBrakesAndHolds) {
  ArmRig rig("fer", Draw(5).pose(1));
  JointVector tau = rig.zero();
  tau[0] = 6;
  rig.lead_to(tau);
  while (rig.dq[0] < 0.6 && rig.arm.mode() == ArmMode::move) rig.torque(tau);
  ASSERT_EQ(rig.arm.mode(), ArmMode::move) << describe(rig.arm.reflex_detail());
  ASSERT_GT(rig.dq[0], 0.5);
  rig.arm.raise(ArmError::instability_detected);
  const double speed = rig.dq[0], before = rig.q[0];
  int periods = 0;
  const auto& limit = load_robot("fer").limits.tau_max;
  for (; rig.dq.cwiseAbs().maxCoeff() > 0.02 && periods < 1000; ++periods) {
    rig.step();
    ASSERT_LE((rig.state().tau_J_d.cwiseAbs() - limit).maxCoeff(), 0);
  }
  EXPECT_LT(periods, 200);
  EXPECT_LT(rig.q[0] - before, speed * 0.1);
  rig.steps(500);
  const JointVector place = rig.q;
  EXPECT_LT((rig.face().q_d - place).cwiseAbs().maxCoeff(), 1e-6) << "the held place is published";
  rig.tau_on_arm[1] = 10;
  rig.steps(500);
  EXPECT_GT((rig.q - place).norm(), 1e-4);
  rig.tau_on_arm.setZero();
  rig.steps(500);
  EXPECT_LT((rig.q - place).norm(), 1e-5);
}

// A load that the arm does not know: damping alone would let the joint creep for ever.
TEST(Motions, ABrakingJointComesToRestAgainstAnUnknownLoad) {
  ArmRig rig("fr3", Draw(5).pose(1));
  rig.hold_by_torque(rig.q, 50);
  rig.tau_on_arm = rig.zero();
  rig.tau_on_arm[5] = 0.5;
  rig.body.update(rig.q, rig.dq);
  const double pull = rig.body.M().llt().solve(rig.tau_on_arm)[5];  // [rad/s^2]
  ASSERT_GT(pull / 120, 0.03) << "faster than a joint that counts as stopped, by damping of 120/s alone";
  const double q_stop = rig.q[5];
  rig.arm.stop_motion();
  rig.steps(2000);
  const JointVector held = rig.q;
  EXPECT_LT(std::abs(held[5] - q_stop), 0.7 * pull / 120)
      << "half a second of creeping, and the spring's way";
  rig.steps(20000);
  EXPECT_LT((rig.q - held).cwiseAbs().maxCoeff(), 1e-5);
  EXPECT_LT(rig.dq.cwiseAbs().maxCoeff(), 1e-5);
}

// The torque that compensates a newly declared load: its weight at its center of mass, by J^T f, a thousandth
// more every period.
TEST(DeclaredLoad, ComesInWithinASecond) {
  ArmRig rig("fer", Draw(8).pose(1));
  const JointVector before = rig.arm.motor_torque(rig.q, rig.zero(), 0);
  const Load load{.mass = 2, .p_FC = {0.05, 0, 0.1}};
  ASSERT_EQ(rig.arm.apply(SetLoad{load}), ArmReply::done);
  rig.body.update(rig.q, rig.zero());
  Eigen::Matrix<double, 3, Eigen::Dynamic> J(3, 7);
  rig.body.point_jacobian(6, rig.body.X_WF() * load.p_FC, J);
  const JointVector weight = J.transpose() * Vector3(0, 0, 2 * 9.81);
  ASSERT_GT(weight.norm(), 3);
  for (int k = 0; k < 1100; ++k) {
    const JointVector tau = rig.arm.motor_torque(rig.q, rig.zero(), 0.001);
    ASSERT_LT((tau - before - std::min(1.0, 1e-3 * k) * weight).norm(), 1e-9) << k;
    rig.arm.measure({.q = rig.q, .dq = rig.zero(), .tau_link = tau});
    ASSERT_EQ(rig.state().load.mass, 2) << "shown at once";
  }
}

// Nothing holds an arm in its place that is guided, and one that has stopped is to stay where it is.
TEST(DeclaredLoad, IsRefusedInAReflexAStopAndGuiding) {
  ArmRig rig("fr3", Draw(9).pose(1));
  const Load load{.mass = 1, .p_FC = {0, 0, 0.1}}, known = rig.state().load;
  const auto expect_refused = [&] {
    EXPECT_EQ(rig.arm.apply(SetLoad{load}), ArmReply::takes_no_load);
    EXPECT_EQ(rig.arm.apply(SetLoad{known}), ArmReply::done) << "nothing new";
    rig.steps(1200);
    EXPECT_EQ(rig.state().load.mass, known.mass);
  };
  rig.arm.raise(ArmError::instability_detected);
  expect_refused();
  rig.arm.apply(RecoverFromError{});
  rig.arm.apply(SetUserStop{true});
  expect_refused();
  rig.arm.apply(SetUserStop{false});
  rig.arm.apply(StopMotion{});
  expect_refused();
  rig.arm.apply(RecoverFromError{});
  rig.arm.press_guiding(true);
  expect_refused();
  rig.arm.press_guiding(false);
  rig.step();
  EXPECT_EQ(rig.arm.apply(SetLoad{load}), ArmReply::done);
  EXPECT_EQ(rig.state().load.mass, 1);
}

TEST(Motions, GuidingYieldsAndAcceptsNoMotion) {
  ArmRig rig("fr3", Draw(6).pose(1));
  rig.arm.press_guiding(true);
  rig.step();
  EXPECT_EQ(rig.face().mode, ArmMode::guiding);
  EXPECT_EQ(rig.arm.start_motion(kTorqueOnly), MotionStart::not_possible);
  const Pose start = rig.face().X_BE;
  rig.F_K_W_on_arm.vector.head<3>() = rig.body.model().X_WB().rotation * Vector3(8, 0, 8);
  rig.steps(400);
  const Vector3 free = rig.face().X_BE.position - start.position;
  EXPECT_GT(free.x(), 0.02);
  EXPECT_GT(free.z(), 0.02);
  rig.F_K_W_on_arm = {};
  rig.arm.press_guiding(false);
  rig.steps(500);
  EXPECT_EQ(rig.face().mode, ArmMode::idle);
  EXPECT_LT(rig.dq.norm(), 1e-6);
  // z locked: the same push moves along x only.
  rig.arm.apply(SetGuidingMode{.axes = {true, true, false, true, true, true}, .elbow = true});
  rig.arm.press_guiding(true);
  const Pose again = rig.face().X_BE;
  rig.F_K_W_on_arm.vector.head<3>() = rig.body.model().X_WB().rotation * Vector3(8, 0, 8);
  rig.steps(400);
  const Vector3 locked = rig.face().X_BE.position - again.position;
  EXPECT_GT(locked.x(), 0.02);
  EXPECT_LT(std::abs(locked.z()), 0.005);
}

// Every generator with every compatible controller: the desired motion is published, a controller of
// the arm follows it, and it finishes at rest. No heap call, no lock.
TEST(Motions, EveryGeneratorRunsAndFinishes) {
  using C = ArmController;
  using G = MotionGenerator;
  for (const std::string& robot : {std::string("fer"), std::string("fr3"), test::kSixAxes}) {
    for (const C controller : {C::joint_impedance, C::cartesian_impedance, C::external}) {
      for (const G generator :
           {G::joint_position, G::joint_velocity, G::cartesian_pose, G::cartesian_velocity}) {
        const std::string what = robot + " " + std::to_string(static_cast<int>(controller)) + " " +
                                 std::to_string(static_cast<int>(generator));
        ArmRig rig(robot, Draw(7).pose(1));
        ASSERT_EQ(rig.arm.start_motion(request(controller, generator)), MotionStart::started) << what;
        rig.step();
        EXPECT_EQ(rig.face().generator, generator);
        EXPECT_EQ(rig.face().controller, controller);
        const JointVector q_0 = rig.face().q_d;
        const Pose X_0 = rig.face().X_BE_d;
        constexpr double kTime = 1.5, kAngle = 0.05, kWay = 0.03;
        InterfaceCommand command;
        command.q_c = q_0;
        command.dq_c = command.tau_J_d = rig.zero();
        int k = 0;
        for (; k <= 1600; ++k) {
          const double t = k * ArmRig::dt, s = smooth(t, kTime);
          const double v = (s - smooth(t - ArmRig::dt, kTime)) / ArmRig::dt;
          command.q_c = q_0.array() + kAngle * s;
          command.dq_c.setConstant(kAngle * v);
          Pose X = X_0;
          X.position.x() += kWay * s;
          Eigen::Map<Eigen::Matrix4d> columns(command.O_T_EE_c.data());
          columns.setIdentity();
          columns.topLeftCorner<3, 3>() = X.rotation;
          columns.topRightCorner<3, 1>() = X.position;
          command.O_dP_EE_c.setZero();
          command.O_dP_EE_c[0] = kWay * v;
          // The program's own law if it computes the torque: it follows the published motion.
          if (controller == C::external) {
            rig.body.update(rig.q, rig.dq);
            const JointVector requested =
                rig.body.M() * (900 * (rig.face().q_d - rig.q) + 60 * (rig.face().dq_d - rig.dq));
            rig.now += (requested - rig.now).cwiseMax(-1).cwiseMin(1);
            command.tau_J_d = rig.now;
          }
          LoopGuard::arm();
          rig.arm.take_command(command);
          const LoopGuardCounts counts = LoopGuard::disarm();
          ASSERT_EQ(counts.heap_calls + counts.lock_calls, 0u) << what;
          rig.step();
          ASSERT_EQ(rig.arm.mode(), ArmMode::move)
              << what << " " << k << ": " << describe(rig.arm.reflex_detail());
        }
        const bool joints = generator == G::joint_position || generator == G::joint_velocity;
        if (joints) {
          EXPECT_LT((rig.face().q_d.array() - q_0.array() - kAngle).abs().maxCoeff(), 1e-6) << what;
        } else {
          EXPECT_NEAR(rig.face().X_BE_d.position.x() - X_0.position.x(), kWay, 1e-6) << what;
        }
        EXPECT_LT((rig.q - rig.face().q_d).cwiseAbs().maxCoeff(), 1e-3) << what;
        command.motion_finished = true;
        rig.command(command);
        EXPECT_EQ(rig.face().mode, ArmMode::idle) << what;
        EXPECT_EQ(rig.arm.motion_end(), MotionEnd::finished) << what;
        const JointVector place = rig.q;
        rig.steps(200);
        EXPECT_LT((rig.q - place).cwiseAbs().maxCoeff(), 2e-3) << what;
        EXPECT_EQ(rig.arm.start_motion(request(controller, generator)), MotionStart::started) << "and again";
      }
    }
  }
}

TEST(Motions, FinishingInMotionIsAnError) {
  ArmRig rig("fer");
  rig.arm.start_motion(request(ArmController::joint_impedance, MotionGenerator::joint_velocity));
  InterfaceCommand command;
  command.dq_c = rig.zero();
  for (int k = 0; k < 300; ++k) {
    command.dq_c[3] = 0.2 * smooth(k * ArmRig::dt, 0.2);
    rig.command(command);
  }
  ASSERT_EQ(rig.arm.mode(), ArmMode::move);
  command.motion_finished = true;
  rig.command(command);
  EXPECT_EQ(rig.arm.motion_end(), MotionEnd::still_moving);
  EXPECT_EQ(rig.face().mode, ArmMode::reflex);
  EXPECT_EQ(rig.face().errors, error_bit(ArmError::joint_motion_generator_velocity_discontinuity));
  const ReflexDetail& detail = rig.arm.reflex_detail();
  EXPECT_EQ(detail.index, 3);
  EXPECT_NEAR(detail.value, 200, 1e-6) << "0.2 rad/s within a millisecond";
  EXPECT_EQ(detail.limit, 12.5);
  rig.steps(500);
  EXPECT_LT(rig.dq.norm(), 1e-4);
}

// An arm whose clock is not the plant's may take two commands between two measurements: each state shows the
// newest one, or a client would take it for lost.
TEST(Motions, TheNewestCommandCanBeShownBeforeItIsMeasured) {
  ArmRig rig("fr3", Draw(8).pose(1));
  rig.arm.start_motion(request(ArmController::joint_impedance, MotionGenerator::joint_position));
  rig.step();
  InterfaceCommand command;
  command.q_c = rig.face().q_d;
  const JointVector before = command.q_c;
  for (int k = 1; k <= 2; ++k) {
    command.q_c[3] += 1e-6;
    rig.arm.take_command(command);
    EXPECT_NEAR(rig.face().q_d[3], before[3] + (k - 1) * 1e-6,
                1e-9);  // of the last measurement or publishing
    rig.arm.publish_desired();
    EXPECT_NEAR(rig.face().q_d[3], command.q_c[3], 1e-9);
    EXPECT_NEAR(rig.face().dq_d[3], 1e-3, 1e-6);
  }
}

// The generator's violations become errors of the arm, with detail; missing commands are handled as before.
TEST(Motions, ErrorsOfTheGeneratorStopTheArm) {
  ArmRig rig("fr3", Draw(8).pose(1));
  rig.arm.start_motion(request(ArmController::joint_impedance, MotionGenerator::joint_position));
  InterfaceCommand command;
  command.q_c = rig.face().q_d;
  for (int k = 0; k < 10; ++k) rig.command(command);
  for (int k = 0; k < 10; ++k) {
    rig.arm.miss_command();
    rig.step();
  }
  ASSERT_EQ(rig.arm.mode(), ArmMode::move);
  command.q_c[2] += 0.01;  // 10 rad/s within a millisecond
  rig.command(command);
  EXPECT_EQ(rig.face().mode, ArmMode::reflex);
  EXPECT_NE(rig.face().errors & error_bit(ArmError::joint_motion_generator_velocity_discontinuity), 0u)
      << error_names(rig.face().errors);
  EXPECT_EQ(rig.arm.reflex_detail().index, 2);
  EXPECT_EQ(rig.arm.motion_end(), MotionEnd::reflex);
  rig.arm.apply(RecoverFromError{});
  rig.arm.start_motion(request(ArmController::joint_impedance, MotionGenerator::joint_position));
  command.q_c = rig.face().q_d;
  command.q_c[0] += 0.2;
  rig.command(command);
  EXPECT_EQ(rig.face().errors, error_bit(ArmError::joint_position_motion_generator_start_pose_invalid));
  rig.arm.apply(RecoverFromError{});
  rig.arm.start_motion(request(ArmController::joint_impedance, MotionGenerator::joint_position));
  command.q_c[0] = std::nan("");
  rig.command(command);
  EXPECT_EQ(rig.arm.motion_end(), MotionEnd::input_error);
  EXPECT_EQ(rig.face().mode, ArmMode::reflex);
}

TEST(Motions, RecoveryLastsUntilTheArmIsAtRest) {
  ArmRig rig("fr3", Draw(10).pose(1));
  ASSERT_EQ(rig.arm.start_motion(kTorqueOnly), MotionStart::started);
  rig.command({.tau_J_d = rig.zero()});
  rig.dq[0] = 1.3;
  rig.command({.tau_J_d = rig.zero()});
  rig.arm.raise(ArmError::joint_reflex);
  EXPECT_EQ(rig.arm.apply(RecoverFromError{}), ArmReply::done);
  EXPECT_EQ(rig.face().errors, 0u);
  int periods = 0;
  for (; rig.face().mode == ArmMode::recovering && periods < 1000; ++periods) {
    EXPECT_EQ(rig.arm.start_motion(kTorqueOnly), MotionStart::not_possible);
    rig.step();
  }
  // Braked by 120/s from 1.3 to the 0.02 rad/s of a joint at rest: 35 ms.
  EXPECT_NEAR(periods, 35, 5);
  ASSERT_EQ(rig.face().mode, ArmMode::idle);
  const auto position = request(ArmController::joint_impedance, MotionGenerator::joint_position);
  ASSERT_EQ(rig.arm.start_motion(position), MotionStart::started);
  const InterfaceCommand stay{.q_c = rig.face().q_d};
  for (int k = 0; k < 100; ++k) rig.command(stay);
  EXPECT_EQ(rig.face().mode, ArmMode::move) << error_names(rig.face().errors);
  EXPECT_LT((rig.q - stay.q_c).cwiseAbs().maxCoeff(), 1e-3);
}

// libfranka names the reasons that it finds in the state that ends a motion which it has seen.
TEST(Motions, AStateShowsEachMotionBeforeItsEnd) {
  ArmRig rig("fr3", Draw(10).pose(1));
  ASSERT_EQ(rig.arm.start_motion(kTorqueOnly), MotionStart::started);
  rig.dq[0] = 4;  // faster than allowed
  rig.step();
  EXPECT_EQ(rig.face().mode, ArmMode::move);
  rig.dq[0] = 4;
  rig.step();
  EXPECT_EQ(rig.face().mode, ArmMode::reflex);
  EXPECT_NE(rig.face().errors & error_bit(ArmError::joint_velocity_violation), 0u);
}

TEST(Motions, PlannedByTheArmItselfWithoutCommands) {
  ArmRig rig("fr3");
  MotionRequest planned = request(ArmController::joint_impedance, MotionGenerator::joint_position);
  planned.asynchronous = true;
  planned.dq_max = joint_constant(7, 0.5);
  ASSERT_EQ(rig.arm.start_motion(planned), MotionStart::started);
  InterfaceCommand command;
  command.q_c = rig.face().q_d.array() + 0.1;
  rig.command(command);
  for (int k = 0; k < 2000; ++k) {
    rig.arm.miss_command();
    rig.step();
    ASSERT_EQ(rig.arm.mode(), ArmMode::move) << describe(rig.arm.reflex_detail());
    ASSERT_LE(rig.face().dq_d.cwiseAbs().maxCoeff(), 0.5 + 1e-9);
  }
  EXPECT_LT((rig.q - command.q_c).cwiseAbs().maxCoeff(), 1e-3);
  EXPECT_EQ(rig.face().command_success_rate, 1);
  command.motion_finished = true;
  rig.command(command);
  rig.steps(1);
  EXPECT_EQ(rig.face().mode, ArmMode::idle);
  EXPECT_EQ(rig.arm.motion_end(), MotionEnd::finished);
}

TEST(Motions, ResetClearsEverythingButTheClock) {
  ArmRig rig("fer");
  rig.arm.start_motion(kTorqueOnly);
  rig.command({.tau_J_d = rig.zero()});
  rig.arm.raise(ArmError::joint_reflex);
  rig.step();
  const auto sequence = rig.state().sequence;
  rig.arm.reset(rig.q);
  rig.step();
  EXPECT_EQ(rig.state().mode, ArmMode::recovering);
  EXPECT_EQ(rig.state().sequence, sequence);
  rig.step();
  EXPECT_EQ(rig.state().mode, ArmMode::idle);
  EXPECT_EQ(rig.face().reflex_reason, 0u);
}

}  // namespace
}  // namespace multipanda::simulated_arm_test
