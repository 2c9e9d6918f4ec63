// Kinematics and inverse kinematics compared with Pinocchio's, and with the definition of least motion.
#include <Eigen/SVD>
#include <gtest/gtest.h>

#include "backends/simulated_arm/inverse_kinematics.hpp"
#include "core/model/model_terms.hpp"
#include "core/testing/test_arm.hpp"
#include "models/arm_source.hpp"

namespace multipanda::motion_kinematics_test {
namespace {

using test::Draw;
using test::TestArm;

std::shared_ptr<const ArmModel> franka(const char* name, const Pose& X_WB) {
  return std::make_shared<const ArmModel>(arm_model_source(load_robot(name), X_WB, false));
}

struct Reference {  // the same quantities by the library
  Reference(std::shared_ptr<const ArmModel> model, const Pose& X_FE) : terms(std::move(model)) {
    terms.set_config({.X_FE = X_FE, .X_EK = {}}, {}, {});
  }
  Pose X_BE(const JointVector& q) {
    terms.update(q, JointVector::Zero(q.size()));
    return terms.model().X_WB().inverse() * terms.X_WE();
  }
  Jacobian J(const JointVector& q) {
    terms.update(q, JointVector::Zero(q.size()));
    const Matrix3 R_BW = terms.model().X_WB().rotation.transpose();
    Jacobian J = terms.J_V_WE();
    J.topRows<3>() = R_BW * J.topRows<3>();
    J.bottomRows<3>() = R_BW * J.bottomRows<3>();
    return J;
  }
  ModelTerms terms;
};

JointVector draw_within(Draw& draw, const ArmModel& model, double share) {
  const JointVector& low = model.limits().q_min;
  const JointVector& high = model.limits().q_max;
  JointVector q(low.size());
  for (Eigen::Index i = 0; i < q.size(); ++i) {
    q[i] = 0.5 * (low[i] + high[i]) + share * draw.uniform(-0.5, 0.5) * (high[i] - low[i]);
  }
  return q;
}

TEST(KinematicChain, AgreesWithTheModelForAnyArm) {
  Draw draw(11);
  std::vector<std::shared_ptr<const ArmModel>> arms{franka("fer", draw.pose(2)), franka("fr3", draw.pose(2))};
  for (const std::size_t n : {1u, 4u, 7u, 9u}) arms.push_back(TestArm::make(n, 5).model(draw.pose(2)));
  for (const auto& model : arms) {
    const Pose X_FE = draw.pose(0.3);
    Reference reference(model, X_FE);
    KinematicChain chain(model);
    chain.set_end_effector(X_FE);
    for (int k = 0; k < 50; ++k) {
      const JointVector q = draw.joints(model->joint_count(), 3);
      Jacobian J;
      const Pose X = chain.X_BE(q, J), expected = reference.X_BE(q);
      EXPECT_LT(pose_error(expected, X).norm(), 1e-13);
      EXPECT_LT(pose_error(expected, chain.X_BE(q)).norm(), 1e-13);
      EXPECT_LT((J - reference.J(q)).norm(), 1e-13);
    }
  }
}

TEST(InverseKinematics, MeetsPoseAndElbowWithinAPeriodsMotion) {
  for (const char* name : {"fer", "fr3"}) {
    Draw draw(21);
    const auto model = franka(name, draw.pose(1));
    const Pose X_FE = draw.pose(0.2);
    Reference reference(model, X_FE);
    InverseKinematics inverse(model);
    inverse.set_end_effector(X_FE);
    int met = 0, tried = 0, most_rounds = 0;
    for (int k = 0; k < 500; ++k) {
      const JointVector q = draw_within(draw, *model, 0.9);
      if (inverse.singular(q) || std::abs(q[3] - kElbowFlip) < 0.05) continue;
      ++tried;
      // The fastest joints' motion in a period, with and without an elbow.
      const JointVector goal = q + draw.joints(7, 5e-3);
      const Pose X = reference.X_BE(goal);
      const auto with = inverse.solve(X, goal[2], q);
      const Pose reached = reference.X_BE(with.q);
      met += with.met;
      most_rounds = std::max(most_rounds, with.rounds);
      if (with.met) {
        EXPECT_LT(pose_error(X, reached).norm(), 3e-10);
        EXPECT_NEAR(with.q[2], goal[2], 1e-10);
        EXPECT_EQ(elbow_of(with.q)[1], elbow_of(q)[1]);
      }
      const auto without = inverse.solve(X, std::nullopt, q);
      ASSERT_TRUE(without.met);
      EXPECT_LT(pose_error(X, reference.X_BE(without.q)).norm(), 3e-10);
      // Least motion: no component in the null space of the Jacobian in between.
      const Jacobian J = reference.J(0.5 * (q + without.q));
      const Eigen::JacobiSVD<Eigen::MatrixXd> svd(Eigen::MatrixXd(J), Eigen::ComputeFullV);
      EXPECT_LT(std::abs(svd.matrixV().col(6).dot(without.q - q)), 0.05 * (without.q - q).norm());
      EXPECT_LE((without.q - q).norm(), (goal - q).norm() + 1e-4);
      most_rounds = std::max(most_rounds, without.rounds);
    }
    EXPECT_GT(tried, 300);
    // With q3 fixed, some poses are singular that are not singular otherwise.
    EXPECT_GT(met, 0.97 * tried);
    EXPECT_LE(most_rounds, InverseKinematics::kMostRounds);
  }
}

TEST(InverseKinematics, FollowsAPathAndComesBackWithTheElbow) {
  Draw draw(31);
  const auto model = franka("fr3", draw.pose(1));
  Reference reference(model, {});
  InverseKinematics inverse(model);
  const JointVector q_start = model->q_home();
  const Pose X_start = reference.X_BE(q_start);
  JointVector q = q_start;
  for (int k = 1; k <= 2000; ++k) {
    const double phase = 2 * M_PI * k / 2000;
    Pose X = X_start;
    X.position += Vector3(0.1 * std::sin(phase), 0.15 * (1 - std::cos(phase)), -0.05 * std::sin(2 * phase));
    X.rotation = exp_rotation({0.3 * std::sin(phase), 0, 0.4 * (1 - std::cos(phase))}) * X_start.rotation;
    const auto& solution = inverse.solve(X, q_start[2] + 0.3 * std::sin(phase), q);
    ASSERT_TRUE(solution.met) << k;
    EXPECT_LE(solution.rounds, 3);
    q = solution.q;
    ASSERT_LT(pose_error(X, reference.X_BE(q)).norm(), 3e-10);
  }
  EXPECT_LT((q - q_start).norm(), 1e-8);  // seven equations: the way back equals the way there
}

TEST(InverseKinematics, ServesOtherJointCounts) {
  Draw draw(41);
  for (const std::size_t n : {6u, 9u, 12u}) {
    const auto model = TestArm::make(n, 7).model(draw.pose(1));
    Reference reference(model, {});
    InverseKinematics inverse(model);
    int tried = 0;
    for (int k = 0; k < 50; ++k) {
      const JointVector q = draw.joints(n, 1.5);
      if (inverse.singular(q)) continue;
      ++tried;
      const Pose X = reference.X_BE(q + draw.joints(n, 2e-3));
      const auto& solution = inverse.solve(X, 0.7, q);  // they have no elbow
      ASSERT_TRUE(solution.met);
      EXPECT_LT(pose_error(X, reference.X_BE(solution.q)).norm(), 3e-10);
    }
    EXPECT_GT(tried, 10);
    EXPECT_EQ(elbow_of(draw.joints(n, 1)), (Elbow{0, 0}));
  }
}

TEST(InverseKinematics, IsBoundedWhereNothingCanMeetThePose) {
  const auto model = franka("fer", {});
  InverseKinematics inverse(model);
  JointVector stretched = JointVector::Zero(7);
  stretched[3] = kElbowFlip;  // shoulder, elbow, wrist on one line
  EXPECT_TRUE(inverse.singular(stretched));
  EXPECT_FALSE(inverse.singular(model->q_home()));
  Pose X = inverse.chain().X_BE(stretched);
  X.position.z() += 0.01;  // out of reach
  const auto& solution = inverse.solve(X, 0.0, stretched);
  EXPECT_FALSE(solution.met);
  EXPECT_TRUE(solution.q.allFinite());
  EXPECT_LE((solution.q - stretched).lpNorm<Eigen::Infinity>(),
            InverseKinematics::kMostRounds * InverseKinematics::kLargestStep);
  stretched[3] = kElbowFlip + 0.1;
  EXPECT_EQ(elbow_of(stretched)[1], 1);
  stretched[3] = kElbowFlip - 0.1;
  EXPECT_EQ(elbow_of(stretched)[1], -1);
}

}  // namespace
}  // namespace multipanda::motion_kinematics_test
