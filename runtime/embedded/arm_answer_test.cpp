// What an arm is answered while drives change, in simulated time: a simulated arm, its commander that needs a
// while to stop and start motions, and a program's orders.
#include "runtime/embedded/arm_answer.hpp"

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "backends/simulated_arm/testing/arm_rig.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::arm_answer_test {
namespace {

using test::ArmRig;
using test::Draw;

MotionRequest motion_of(ArmDrive drive) {
  MotionRequest request;
  if (drive == ArmDrive::effort) return request;
  request.controller = drive == ArmDrive::cartesian_pose || drive == ArmDrive::cartesian_velocity
                           ? ArmController::cartesian_impedance
                           : ArmController::joint_impedance;
  request.generator = drive == ArmDrive::joint_position   ? MotionGenerator::joint_position
                      : drive == ArmDrive::joint_velocity ? MotionGenerator::joint_velocity
                      : drive == ArmDrive::cartesian_pose ? MotionGenerator::cartesian_pose
                                                          : MotionGenerator::cartesian_velocity;
  return request;
}

struct Scenario {
  Scenario()
      : rig("fer", Draw(3).pose(1)), answer(rig.body.shared_model(), FollowerLimits::of(load_robot("fer"))) {}

  void select(ArmDrive drive) {
    ++order.change;
    order.drive = drive;
    order.number = 0;
    order.resumed = answer.holds();
  }
  void write(std::span<const double> values) {
    ++order.number;
    order.stamp_ns = t;
    std::copy(values.begin(), values.end(), order.values.begin());
  }
  DesiredMotionState desired() const {
    const InterfaceState& s = rig.face();
    DesiredMotionState d;
    std::copy(s.q_d.begin(), s.q_d.end(), d.q_d.begin());
    std::copy(s.dq_d.begin(), s.dq_d.end(), d.dq_d.begin());
    std::copy(s.ddq_d.begin(), s.ddq_d.end(), d.ddq_d.begin());
    Eigen::Map<Eigen::Matrix4d> T(d.O_T_EE_c.data());
    T.setIdentity();
    T.topLeftCorner<3, 3>() = s.X_BE_c.rotation;
    T.topRightCorner<3, 1>() = s.X_BE_c.position;
    std::copy(s.V_BE_c.vector.begin(), s.V_BE_c.vector.end(), d.O_dP_EE_c.begin());
    std::copy(s.A_BE_c.begin(), s.A_BE_c.end(), d.O_ddP_EE_c.begin());
    return d;
  }

  // One packet: the answer, and the commander, which is kCommander periods late.
  void step() {
    t += 1'000'000;
    const ArmDrive shown = rig.arm.mode() == ArmMode::move ? running : ArmDrive::none;
    const auto kind = answer.step(order, rig.state(), desired(), shown);
    if (const auto drive = answer.take_request()) {
      asked = drive;
      asked_speed = rig.dq.lpNorm<Eigen::Infinity>();
      wait = kCommander;
      ++requests;
    }
    if (kind == ArmAnswer::Kind::none && rig.arm.mode() == ArmMode::move) ++unanswered;
    if (kind == ArmAnswer::Kind::torque) {
      InterfaceCommand command;
      command.tau_J_d = answer.torque();
      rig.arm.take_command(command);
    } else if (kind == ArmAnswer::Kind::motion) {
      rig.arm.take_command(answer.motion());
    }
    rig.step();
    if (rig.arm.errors() != 0) reflex = true;
    if (asked && --wait == 0) {
      if (rig.arm.mode() == ArmMode::move) rig.arm.stop_motion();
      running = *asked;
      if (running != ArmDrive::none)
        started = rig.arm.start_motion(motion_of(running)) == MotionStart::started;
      asked.reset();
    }
  }
  void steps(int count) {
    for (int k = 0; k < count; ++k) step();
  }

  void writes(std::span<const double> values, int count) {
    for (int k = 0; k < count; ++k) {
      write(values);
      step();
    }
  }

  static constexpr int kCommander = 12;
  ArmRig rig;
  ArmAnswer answer;
  ArmOrder order;
  ArmDrive running = ArmDrive::none;
  std::optional<ArmDrive> asked;
  int wait = 0, unanswered = 0, requests = 0;
  double asked_speed = -1;
  bool reflex = false, started = false;
  std::int64_t t = 0;
};

constexpr std::array<double, 7> kNothing{};

// An effort controller that pushes joint 1, and is stopped in full motion.
TEST(ArmAnswer, AnEffortControllerThatEndsLeavesTheArmBrakedAndAnsweredUntilItLeavesTheMotion) {
  Scenario s;
  s.select(ArmDrive::effort);
  s.writes(kNothing, 150);
  ASSERT_EQ(s.rig.arm.mode(), ArmMode::move);
  EXPECT_TRUE(s.answer.follows());
  std::array<double, 7> tau{};
  while (s.rig.dq[0] < 0.7) {
    tau[0] = std::min(20.0, tau[0] + 0.5);
    s.write(tau);
    s.step();
    ASSERT_LT(s.t, 3'000'000'000);
  }
  s.select(ArmDrive::none);
  const double q = s.rig.q[0];
  s.steps(20);
  EXPECT_EQ(s.requests, 1);  // effort; not stopped while it moves
  EXPECT_LT(s.answer.torque()[0], 0);
  EXPECT_FALSE(s.answer.follows());
  s.steps(600);
  EXPECT_EQ(s.requests, 2);
  EXPECT_LT(s.asked_speed, 0.02);
  EXPECT_EQ(s.rig.arm.mode(), ArmMode::idle);
  EXPECT_EQ(s.unanswered, 0);
  EXPECT_FALSE(s.reflex);
  EXPECT_LT(s.rig.q[0] - q, 0.06);
}

TEST(ArmAnswer, AVelocityControllerThatIsReplacedStopsWithinTheLimitsFirst) {
  Scenario s;
  s.select(ArmDrive::joint_velocity);
  s.steps(20);
  ASSERT_TRUE(s.started);
  std::array<double, 7> v{};
  for (int k = 0; k < 800; ++k) {
    v[3] = std::min(0.8, v[3] + 1e-3);
    s.write(v);
    s.step();
  }
  EXPECT_NEAR(s.rig.face().dq_d[3], 0.8, 0.02);
  s.select(ArmDrive::effort);
  s.write(kNothing);
  s.steps(5);
  EXPECT_EQ(s.requests, 1);
  s.steps(600);
  EXPECT_EQ(s.requests, 2);
  EXPECT_FALSE(s.reflex);
  EXPECT_EQ(s.unanswered, 0);
  EXPECT_EQ(s.rig.arm.mode(), ArmMode::move);
  EXPECT_EQ(s.running, ArmDrive::effort);
  // The new program has not written for 0.5 s: it holds.
  EXPECT_FALSE(s.answer.follows());
  EXPECT_LT(s.rig.dq.lpNorm<Eigen::Infinity>(), 0.01);
}

TEST(ArmAnswer, ADriveThatIsSelectedAgainAtOnceGoesOnWithoutAStop) {
  Scenario s;
  s.select(ArmDrive::effort);
  s.writes(kNothing, 150);
  s.select(ArmDrive::none);
  s.steps(5);
  s.select(ArmDrive::effort);
  for (int k = 0; k < 300; ++k) {
    s.write(kNothing);
    s.step();
  }
  EXPECT_EQ(s.requests, 1);
  EXPECT_TRUE(s.answer.follows());
  EXPECT_EQ(s.unanswered, 0);
}

TEST(ArmAnswer, CommandsThatAreNotFiniteEndTheMotion) {
  for (const ArmDrive drive : {ArmDrive::effort, ArmDrive::joint_position, ArmDrive::cartesian_pose}) {
    Scenario s;
    s.select(drive);
    s.steps(30);
    ASSERT_EQ(s.rig.arm.mode(), ArmMode::move);
    std::array<double, 16> values{};
    values[5] = std::numeric_limits<double>::quiet_NaN();
    s.write(values);
    s.steps(200);
    EXPECT_EQ(s.rig.arm.mode(), ArmMode::idle);
    EXPECT_FALSE(s.reflex);
    EXPECT_EQ(s.unanswered, 0);
  }
}

TEST(ArmAnswer, ASilentProgramIsCountedOnceAndFollowedAgainWhenItKnows) {
  Scenario s;
  s.select(ArmDrive::effort);
  s.writes(kNothing, 150);
  EXPECT_EQ(s.answer.holds(), 0u);
  s.steps(200);
  EXPECT_EQ(s.answer.holds(), 1u);
  EXPECT_FALSE(s.answer.follows());
  for (int k = 0; k < 50; ++k) {
    s.write(kNothing);
    s.step();
  }
  EXPECT_FALSE(s.answer.follows());
  s.order.resumed = s.answer.holds();
  for (int k = 0; k < 150; ++k) {
    s.write(kNothing);
    s.step();
  }
  EXPECT_TRUE(s.answer.follows());
  EXPECT_EQ(s.answer.holds(), 1u);
  EXPECT_EQ(s.unanswered, 0);
  EXPECT_FALSE(s.reflex);
}

// A program that stalled while its arm was stopped, and a person recovers the arm: the torques that it wrote
// last are of any age.
TEST(ArmAnswer, ATorqueOfBeforeTheMotionIsNeverSent) {
  Scenario s;
  s.select(ArmDrive::effort);
  s.steps(2);
  std::array<double, 7> old{};
  old[0] = 15;
  s.write(old);
  double most = 0;
  for (int k = 0; k < 300; ++k) {
    s.step();
    if (s.rig.arm.mode() == ArmMode::move) most = std::max(most, std::abs(s.answer.torque()[0]));
  }
  ASSERT_EQ(s.rig.arm.mode(), ArmMode::move);
  EXPECT_LT(most, 0.1);
  EXPECT_LT(s.rig.dq.lpNorm<Eigen::Infinity>(), 1e-3);
  EXPECT_FALSE(s.answer.follows());
  // Torques that it writes now fade in.
  old[0] = 3;
  s.writes(old, 20);
  EXPECT_LT(s.answer.torque()[0], 1);
  s.writes(old, 100);
  EXPECT_TRUE(s.answer.follows());
  EXPECT_FALSE(s.reflex);
  EXPECT_EQ(s.answer.holds(), 0u);
}

// The same after a reflex, and for positions: the old one is 0.5 rad away.
TEST(ArmAnswer, AfterARecoveryTheCommandsOfBeforeDoNotCount) {
  for (const ArmDrive drive : {ArmDrive::effort, ArmDrive::joint_position}) {
    Scenario s;
    s.select(drive);
    std::array<double, 7> values{};
    if (drive == ArmDrive::joint_position) std::copy_n(s.rig.q.begin(), 7, values.begin());
    s.steps(20);
    s.writes(values, 150);
    ASSERT_TRUE(s.answer.follows());
    s.rig.arm.raise(ArmError::joint_reflex);
    s.steps(50);
    ASSERT_EQ(s.rig.arm.mode(), ArmMode::reflex);
    values[0] += drive == ArmDrive::effort ? 15 : 0.5;
    s.write(values);
    s.steps(10);
    ASSERT_EQ(s.rig.arm.apply(RecoverFromError{}), ArmReply::done);
    while (s.rig.arm.mode() != ArmMode::idle) s.step();
    ASSERT_EQ(s.rig.arm.start_motion(motion_of(drive)), MotionStart::started);
    const JointVector q = s.rig.q;
    s.steps(100);
    ASSERT_EQ(s.rig.arm.mode(), ArmMode::move);
    EXPECT_FALSE(s.answer.follows());
    EXPECT_LT((s.rig.q - q).lpNorm<Eigen::Infinity>(), 1e-3);
  }
}

// A program that falls silent while its torques still fade in must begin again, too.
TEST(ArmAnswer, SilenceWhileTorquesFadeInIsCounted) {
  Scenario s;
  s.select(ArmDrive::effort);
  s.writes(kNothing, 50);
  EXPECT_FALSE(s.answer.follows());
  s.steps(50);
  EXPECT_EQ(s.answer.holds(), 1u);
}

}  // namespace
}  // namespace multipanda::arm_answer_test
