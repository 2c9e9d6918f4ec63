// What is computed for goals and parameters of multipanda_ros2, without ROS.
#include "ros/adapter/compat/goals.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/cycle/control_cycle.hpp"
#include "ros/adapter/compat/controllet_names.hpp"
#include "ros/adapter/compat/mode_services.hpp"
#include "ros/adapter/state/testing/state_fixture.hpp"

namespace multipanda::ros::goals_test {
namespace {

using testing::HasSubstr;

HostTime at_ms(double ms) { return HostTime{1000000000 + std::llround(1e6 * ms)}; }

JointVector joints(double value) { return JointVector::Constant(7, value); }

constexpr double kFresh = 0.001;                                    // age of the arm's state [s]
double first_step(double dq) { return VelocityGoal::kFirst * dq; }  // the first set-point, the arm being at 0

template <class F>
std::string refusal(F f) {
  try {
    f();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

// The set-point is the integral of the velocities over the sender's own times, whatever its rate.
TEST(VelocityGoal, IsIntegratedOverTime) {
  std::mt19937 random(4);
  std::uniform_real_distribution<> step_ms(0.5, 40), velocity(-0.3, 0.3);
  VelocityGoal goal(joints(2), 0.1);
  const JointVector q = joints(0.4);
  JointVector expected = q;
  double t = 0;
  for (int k = 0; k < 50; ++k) {
    const double dt = k == 0 ? 1 : step_ms(random);
    t += dt;
    const JointVector dq = joints(velocity(random));
    expected += 1e-3 * dt * dq;
    if ((expected - q).cwiseAbs().maxCoeff() > 0.09) break;
    EXPECT_LT((goal.next(dq, q, kFresh, at_ms(t)) - expected).norm(), 1e-8)
        << k;  // times in whole nanoseconds
  }
  // At 1 kHz it is multipanda_ros2's own rule, 0.001 s per message.
  VelocityGoal fast(joints(2), 0.1);
  JointVector q_d;
  for (int k = 0; k < 30; ++k) q_d = fast.next(joints(0.5), q, kFresh, at_ms(k));
  EXPECT_LT((q_d - joints(0.4 + 30 * 0.001 * 0.5)).norm(), 1e-9);
}

TEST(VelocityGoal, StartsAgainWhereTheArmIsAfterAPauseOrARefusal) {
  VelocityGoal goal(joints(2), 0.1);
  (void)goal.next(joints(1), joints(0), kFresh, at_ms(0));
  (void)goal.next(joints(1), joints(0.02), kFresh, at_ms(50));
  EXPECT_NEAR(goal.next(joints(1), joints(0.5), kFresh, at_ms(151))[3], 0.501, 1e-9)
      << "silent for more than 0.1 s";
  EXPECT_NEAR(goal.next(joints(1), joints(0.5), kFresh, at_ms(161))[3], 0.511, 1e-9);
  EXPECT_THAT(refusal([&] { (void)goal.next(joints(1), joints(0.3), kFresh, at_ms(170)); }),
              HasSubstr("set-point is 0.22 rad away from the arm"));
  EXPECT_NEAR(goal.next(joints(0), joints(0.3), kFresh, at_ms(171))[3], 0.3, 1e-9);
  JointVector fast = joints(0.1);
  fast[4] = -2.1;
  EXPECT_THAT(refusal([&] { (void)goal.next(fast, joints(0.3), kFresh, at_ms(172)); }),
              HasSubstr("joint 5: -2.1 rad/s is above its limit, 2 rad/s"));
  fast[4] = NAN;
  EXPECT_THAT(refusal([&] { (void)goal.next(fast, joints(0.3), kFresh, at_ms(173)); }),
              HasSubstr("not finite"));
  EXPECT_NEAR(goal.next(joints(1), joints(0.7), kFresh, at_ms(174))[3], 0.701, 1e-9);
}

// Against a person or an obstacle: one push of at most the window, not one after the other.
TEST(VelocityGoal, ThatRanAwayIsRefusedUntilItStopsTurnsOrPauses) {
  enum class End { zero, reversed, pause };
  for (const End end : {End::zero, End::reversed, End::pause}) {
    VelocityGoal goal(joints(2), 0.1);
    JointVector q = joints(0), dq = joints(0);
    dq[2] = -0.5;
    std::size_t taken = 0, refused = 0;
    double t = 0, most = 0;
    for (; t < 2000; t += 10) {  // the arm does not move
      if (refusal([&] { most = std::max(most, -goal.next(dq, q, kFresh, at_ms(t))[2]); }).empty()) {
        ++taken;
        EXPECT_EQ(refused, 0u) << "taken again after " << t << " ms";
      } else {
        ++refused;
      }
    }
    EXPECT_LE(most, VelocityGoal::kWindow);
    EXPECT_EQ(taken,
              20u);  // 0.001 s and 19 times 0.01 s at 0.5 rad/s are 0.0955 rad; the next one is too far
    dq[5] = 0.1;     // another joint does not free it
    EXPECT_THAT(refusal([&] { (void)goal.next(dq, q, kFresh, at_ms(t)); }),
                HasSubstr("joint 3 did not follow"));
    if (end == End::pause) t += 101;
    if (end == End::zero) dq[2] = 0;
    if (end == End::reversed) dq[2] = 0.5;
    EXPECT_NEAR(goal.next(dq, q, kFresh, at_ms(t + 10))[2], first_step(dq[2]), 1e-12);
  }
}

TEST(VelocityGoal, ThatBecomesZeroStaysWhereTheArmIs) {
  VelocityGoal goal(joints(2), 0.1);
  JointVector dq = joints(0.4), q = joints(0.2);
  for (int k = 0; k < 10; ++k) (void)goal.next(dq, q, kFresh, at_ms(10 * k));
  dq[1] = 0;
  q[1] = 0.21;
  const JointVector first = goal.next(dq, q, kFresh, at_ms(100));
  EXPECT_EQ(first[1], 0.21);
  EXPECT_NEAR(first[0], 0.2 + 0.4 * 0.101, 1e-9);
  q[1] = 0.205;  // sags: the set-point must not sink with it
  EXPECT_EQ(goal.next(dq, q, kFresh, at_ms(110))[1], 0.21);
}

// An old position would be the start of the next motion, and the measure of its window.
TEST(VelocityGoal, IsRefusedWhileTheStateIsOld) {
  VelocityGoal goal(joints(2), 0.1);
  EXPECT_THAT(refusal([&] { (void)goal.next(joints(0), joints(0), 0.2, at_ms(0)); }), HasSubstr("0.2 s old"));
  EXPECT_EQ(refusal([&] { (void)goal.next(joints(0), joints(0), 0.9 * kOldestState, at_ms(1)); }), "");
}

// The energy of a displacement is the same in both frames.
TEST(Stiffness, OfTheBaseBecomesThatOfTheWorld) {
  Eigen::Matrix<double, 6, 6> K = Vector6(100, 200, 300, 10, 20, 30).asDiagonal();
  const std::span<const double> values(K.data(), 36);
  const Matrix3 quarter = Eigen::AngleAxisd(M_PI / 2, Vector3::UnitZ()).toRotationMatrix();
  const Vector6 turned = stiffness_in_world(values, quarter);
  EXPECT_LT((turned - Vector6(200, 100, 300, 20, 10, 30)).norm(), 1e-9);
  const Matrix3 any = Eigen::AngleAxisd(0.7, Vector3(1, 2, 3).normalized()).toRotationMatrix();
  EXPECT_THAT(refusal([&] { (void)stiffness_in_world(values, any); }), HasSubstr("diagonal in the axes"));
  K = Vector6(400, 400, 400, 20, 20, 20).asDiagonal();
  EXPECT_LT((stiffness_in_world(values, any) - Vector6(400, 400, 400, 20, 20, 20)).norm(), 1e-9);
  K(0, 3) = 5;
  EXPECT_THAT(refusal([&] { (void)stiffness_in_world(values, Matrix3::Identity()); }), HasSubstr("diagonal"));
  K(0, 3) = NAN;
  EXPECT_THAT(refusal([&] { (void)stiffness_in_world(values, Matrix3::Identity()); }), HasSubstr("finite"));
}

TEST(Names, MeanTheFirstInstanceOfTheirTypeAndArms) {
  test::StateFixture fixture(
      "arms:\n  - name: left\n  - {name: right, base: {position_m: [0, -1, 0]}}\n"
      "controllets:\n"
      "  - {name: soft, type: joint_impedance, arms: left}\n"
      "  - {name: stiff, type: joint_impedance, arms: left}\n"
      "  - {name: hand, type: cartesian_impedance, arms: right}\n"
      "  - {name: both, type: dual_cartesian_impedance, arms: [right, left]}\n"
      "  - {name: push, type: force, arms: left}\n");
  const MultimodeController& modes = *fixture.run_context().modes;
  std::string why;
  const auto found = [&](const char* name, const char* resource) {
    why.clear();
    const auto i = instance_of(modes, name, resource, why);
    return i ? modes.instance(*i).name() : "";
  };
  EXPECT_EQ(found("panda_joint_impedance_controller", "left"), "soft");
  EXPECT_EQ(found("comless_panda_joint_impedance_controller", "left"), "soft");
  EXPECT_EQ(found("panda_joint_velocity_controller", "left"), "soft");
  EXPECT_EQ(found("twin_cartesian_impedance_controller", "right&left"), "both");
  EXPECT_EQ(found("stiff", "left"), "stiff") << "our own names";
  EXPECT_EQ(found("push", "left"), "push");
  EXPECT_EQ(found("dual_cartesian_impedance_controller", "left&right"), "");
  EXPECT_THAT(why, HasSubstr("it has one for 'right&left'"));
  EXPECT_EQ(found("panda_joint_impedance_controller", "right"), "");
  EXPECT_THAT(why, HasSubstr("no controllet of type 'joint_impedance' for these arms"));
  EXPECT_EQ(found("twin_joint_impedance_controller", "right&left"), "");
  EXPECT_THAT(why, HasSubstr("panda_joint_impedance_controller for each arm"));
  EXPECT_EQ(found("panda_joint_impedance_controler", "left"), "");
  EXPECT_THAT(why, HasSubstr("did you mean 'panda_joint_impedance_controller'?"));
  EXPECT_EQ(found("stiff", "right"), "");
  EXPECT_EQ(their_name(modes, modes.find("soft")), "panda_joint_impedance_controller");
  EXPECT_EQ(their_name(modes, modes.find("stiff")), "stiff");
  EXPECT_EQ(their_name(modes, modes.find("both")), "dual_cartesian_impedance_controller");
  EXPECT_EQ(their_name(modes, modes.find("push")), "push");
  EXPECT_EQ(resource_name(modes, modes.instance(modes.find("both")).arm_list(), "_and_"), "right_and_left");
}

}  // namespace
}  // namespace multipanda::ros::goals_test
