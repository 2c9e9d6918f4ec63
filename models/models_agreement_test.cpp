// URDF (Pinocchio) and MJCF (MuJoCo) are written from the same figures: two independent engines must find the
// same arm in them.
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "models/robot_description.hpp"
#include "models/testing/two_engines.hpp"
#include "models/write_robot.hpp"

namespace multipanda::models_agreement_test {
namespace {

using namespace test;
using Eigen::VectorXd;

constexpr int kConfigurations = 200;

struct Case {
  const char* robot;
  bool hand;
};

std::string path_of(const std::string& robot) {
  return robot == "ur5e" ? MULTIPANDA_SOURCE_DIR "/tests/models/ur5e.yaml" : robot;
}

class Agreement : public testing::TestWithParam<Case> {};

TEST_P(Agreement, UrdfAndMjcfAreTheSameArm) {
  const auto [name, hand] = GetParam();
  const RobotDescription robot = load_robot(path_of(name));
  MujocoArm mujoco(to_mjcf(robot, {.hand = hand}));
  PinocchioArm pinocchio(to_urdf(robot, {.hand = hand}));
  ASSERT_EQ(mujoco.joints(), static_cast<int>(robot.joint_count()));
  ASSERT_EQ(pinocchio.joints(), static_cast<int>(robot.joint_count()));
  const std::vector<std::string> frames =
      hand ? std::vector<std::string>{"flange", "hand_tcp"} : std::vector<std::string>{"flange"};
  Random random(20240607);
  double largest_coriolis = 0;
  for (int i = 0; i < kConfigurations && !HasFailure(); ++i) {
    SCOPED_TRACE(i);
    const Pose X_WB = random.pose();
    mujoco.place_base(X_WB);
    pinocchio.place_base(X_WB);
    const VectorXd q = random.between(robot.limits.q_min, robot.limits.q_max);
    const VectorXd dq = random.between(-robot.limits.dq_max, robot.limits.dq_max);
    const Terms a = mujoco.terms(q, dq, frames);
    expect_equal(a, pinocchio.terms(q, dq, frames));
    largest_coriolis = std::max(largest_coriolis, a.c.norm());
  }
  EXPECT_GT(largest_coriolis, 1.0);  // c is large enough for a meaningful comparison
}

class MovableHand : public testing::TestWithParam<const char*> {};

// A hand with movable fingers, held closed, is the rigid hand: checks the merging of the three bodies with an
// independent engine.
TEST_P(MovableHand, HeldClosedWeighsTheSameAsTheRigidOne) {
  const RobotDescription robot = load_robot(GetParam());
  MujocoArm locked(to_mjcf(robot, {.hand = true}));
  MujocoArm movable(to_mjcf(robot, {.hand = true, .fingers = Fingers::movable}));
  const auto n = static_cast<Eigen::Index>(robot.joint_count());
  ASSERT_EQ(movable.joints(), n + 2);
  Random random(7);
  for (int i = 0; i < 50 && !HasFailure(); ++i) {
    const Pose X_WB = random.pose();
    locked.place_base(X_WB);
    movable.place_base(X_WB);
    const VectorXd q = random.between(robot.limits.q_min, robot.limits.q_max);
    const VectorXd dq = random.between(-robot.limits.dq_max, robot.limits.dq_max);
    VectorXd q2 = VectorXd::Zero(n + 2), dq2 = VectorXd::Zero(n + 2);
    q2.head(n) = q;
    dq2.head(n) = dq;
    Terms b = movable.terms(q2, dq2, {"flange", "hand_tcp"});
    b.M = Eigen::MatrixXd(b.M.topLeftCorner(n, n));
    b.c = VectorXd(b.c.head(n));
    b.g = VectorXd(b.g.head(n));
    for (auto& J : b.jacobians) J = RowMatrix(J.leftCols(n));
    expect_equal(locked.terms(q, dq, {"flange", "hand_tcp"}), b);
  }
}

INSTANTIATE_TEST_SUITE_P(Robots, Agreement,
                         testing::Values(Case{"fer", false}, Case{"fer", true}, Case{"fr3", false},
                                         Case{"fr3", true}, Case{"fr3v2", false}, Case{"fr3v2", true},
                                         Case{"ur5e", false}),
                         [](const auto& param) {
                           return std::string(param.param.robot) + (param.param.hand ? "_hand" : "");
                         });

INSTANTIATE_TEST_SUITE_P(Robots, MovableHand, testing::Values("fer", "fr3", "fr3v2"),
                         [](const auto& param) { return std::string(param.param); });

// Known poses, by hand.
TEST(Kinematics, ReadyPoseOfTheFrankaArmInClosedForm) {
  const RobotDescription robot = load_robot("fer");
  PinocchioArm arm(to_urdf(robot, {.hand = true}));
  const auto terms = arm.terms(robot.q_home, VectorXd::Zero(7), {"flange", "hand_tcp"});
  // In the plane y = 0: the upper arm leans back by 45 degrees, the forearm is level, the flange looks down.
  const double s = std::sqrt(0.5);
  const double x = -0.316 * s + 0.0825 * s + 0.384 + 0.088;
  const double z = 0.333 + 0.316 * s + 0.0825 * s + 0.0825 - 0.107;
  EXPECT_LT((terms.poses[0].position - Vector3(x, 0, z)).norm(), 1e-8);  // the pose is given to 9 digits
  EXPECT_LT((terms.poses[1].position - Vector3(x, 0, z - 0.1034)).norm(), 1e-8);
  EXPECT_LT((terms.poses[1].rotation - Matrix3(Vector3(1, -1, -1).asDiagonal())).norm(), 1e-7);
}

TEST(Kinematics, Ur5eFollowsItsDenavitHartenbergFigures) {
  const RobotDescription robot = load_robot(path_of("ur5e"));
  PinocchioArm arm(to_urdf(robot));
  const std::array<double, 6> d{0.1625, 0, 0, 0.1333, 0.0997, 0.0996}, a{0, -0.425, -0.3922, 0, 0, 0};
  const std::array<double, 6> alpha{M_PI_2, 0, 0, M_PI_2, -M_PI_2, 0};
  Random random(5);
  for (int i = 0; i < 20; ++i) {
    const VectorXd q = random.between(robot.limits.q_min, robot.limits.q_max);
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    for (std::size_t j = 0; j < 6; ++j) {
      T = T * Eigen::AngleAxisd(q[static_cast<Eigen::Index>(j)], Vector3::UnitZ()) *
          Eigen::Translation3d(a[j], 0, d[j]) * Eigen::AngleAxisd(alpha[j], Vector3::UnitX());
    }
    const auto terms = arm.terms(q, VectorXd::Zero(6), {"flange"});
    ASSERT_LT((terms.poses[0].position - T.translation()).norm(), 1e-12);
    ASSERT_LT((terms.poses[0].rotation - T.linear()).norm(), 1e-12);
  }
}

}  // namespace
}  // namespace multipanda::models_agreement_test
