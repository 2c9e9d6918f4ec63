#include "core/model/task_space.hpp"

#include <gtest/gtest.h>

#include "core/model/model_terms.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/plain_arm.hpp"

namespace multipanda::task_space_test {
namespace {

using namespace test;
using Eigen::MatrixXd;

TEST(TaskSpace, IsTheTextbookInverseInRegularPoses) {
  Draw draw(101);
  int checked = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const std::size_t n = 6 + static_cast<std::size_t>(trial % 3);
    const PlainArm plain(TestArm::make(n), {});
    ModelTerms terms(TestArm::make(n).model());
    const JointVector q = bent(n) + draw.joints(n, 0.5);
    terms.update(q, joint_constant(n, 0));
    const TaskSpace& task = terms.task();
    const MatrixXd J = plain.jacobian(q), M = plain.mass(q);
    const MatrixXd A = J * inverse(M) * J.transpose();
    EXPECT_NEAR((task.mobility - A).norm(), 0, 1e-8 * A.norm());
    const double smallest = symmetric_eigenvalues(A).minCoeff();
    ASSERT_EQ(task.floored, smallest < TaskSpace::kMobilityFloor) << smallest;
    if (task.floored) continue;
    ++checked;
    EXPECT_NEAR((task.Lambda * A - MatrixXd::Identity(6, 6)).norm(), 0, 1e-8);
    EXPECT_NEAR((J * task.J_bar - MatrixXd::Identity(6, 6)).norm(), 0, 1e-8);
    const JointVector x = draw.joints(n, 1);
    EXPECT_NEAR((J * (inverse(M) * task.null_space_torque(terms.J_V_WE(), x))).norm(), 0, 1e-7);
    EXPECT_NEAR((J * task.null_space_velocity(terms.J_V_WE(), x)).norm(), 0, 1e-8);
  }
  EXPECT_GE(checked, 20);
}

// A torque at a blocked hand: the wrench A^-1 J M^-1 tau, whether or not the floor acts.
TEST(TaskSpace, PressIsThatOfTheArmWithoutFloor) {
  Draw draw(105);
  int floored = 0;
  for (int trial = 0; trial < 40; ++trial) {
    const MatrixXd half = MatrixXd::NullaryExpr(7, 7, [&] { return draw.uniform(-1, 1); });
    const MatrixXd M = half * half.transpose() + 0.5 * MatrixXd::Identity(7, 7);
    MatrixXd J = MatrixXd::NullaryExpr(6, 7, [&] { return draw.uniform(-1, 1); });
    J.row(2) = (trial % 2 == 0 ? 0.05 : 1.0) * J.row(2) + J.row(1);
    TaskSpace task;
    compute_task_space(J, M, task);
    const MatrixXd A = J * inverse(M) * J.transpose();
    if (symmetric_eigenvalues(A).minCoeff() < 2 * TaskSpace::kPressFloor) continue;
    const JointVector tau = draw.joints(7, 1);
    const Eigen::VectorXd expected = inverse(A) * J * inverse(M) * tau;
    const Vector6 f = task.press() * Vector6(task.J_bar.transpose() * tau);
    EXPECT_LT((f - expected).norm(), 1e-6 * (1 + expected.norm()));
    floored += task.floored;
  }
  EXPECT_GE(floored, 10);
}

// The same law holds for every joint count, with a fixed or a dynamic size.
TEST(TaskSpace, EveryJointCountFollowsTheSameLaw) {
  Draw draw(104);
  for (std::size_t n = 1; n <= kMaxJoints; ++n) {
    const auto size = static_cast<Eigen::Index>(n);
    for (int trial = 0; trial < 5; ++trial) {
      const MatrixXd J = MatrixXd::NullaryExpr(6, size, [&] { return draw.uniform(-1, 1); });
      const MatrixXd half = MatrixXd::NullaryExpr(size, size, [&] { return draw.uniform(-1, 1); });
      const MatrixXd M = half * half.transpose() + 0.5 * MatrixXd::Identity(size, size);
      TaskSpace task;
      compute_task_space(J, M, task);
      const MatrixXd A = J * inverse(M) * J.transpose();
      const MatrixXd Lambda = floored_symmetric_inverse(A, TaskSpace::kMobilityFloor);
      ASSERT_LT((task.mobility - A).norm(), 1e-10) << n;
      ASSERT_LT((task.Lambda - Lambda).norm(), 1e-8) << n;
      ASSERT_EQ(task.J_bar.rows(), size);
      ASSERT_LT((task.J_bar - inverse(M) * J.transpose() * Lambda).norm(), 1e-7) << n;
    }
  }
}

// Five joints: A has rank five. No direction is heavier than 1/floor, and N remains a contraction in the
// metric of M^-1: the eigenvalues of N lie within [0, 1].
TEST(TaskSpace, SingularPosesStayBounded) {
  Draw draw(102);
  for (int trial = 0; trial < 30; ++trial) {
    ModelTerms terms(TestArm::make(5).model());
    terms.update(draw.joints(5, 2), joint_constant(5, 0));
    const TaskSpace& task = terms.task();
    EXPECT_TRUE(task.floored);
    const double largest = symmetric_eigenvalues(task.Lambda).maxCoeff();
    EXPECT_NEAR(largest, 1 / TaskSpace::kMobilityFloor, 1e-6);
    const MatrixXd J = terms.J_V_WE();
    const MatrixXd N = MatrixXd::Identity(5, 5) - J.transpose() * task.J_bar.transpose();
    const Eigen::VectorXcd values = eigenvalues(N);
    for (const auto& value : values) {
      EXPECT_NEAR(value.imag(), 0, 1e-6);
      EXPECT_GE(value.real(), -1e-8);
      EXPECT_LE(value.real(), 1 + 1e-8);
    }
  }
}

// The two methods of inversion agree where the floor begins to act.
TEST(TaskSpace, FloorActsWithoutAStep) {
  const Matrix3 R = Draw(103).rotation();
  Matrix6 Q = Matrix6::Identity();
  Q.topLeftCorner<3, 3>() = R;
  Vector6 eigenvalues;
  eigenvalues << TaskSpace::kMobilityFloor, 1, 2, 3, 4, 5;
  const auto inverse = [&](double change, bool& floored) {
    Vector6 e = eigenvalues;
    e[0] += change;
    return floored_inverse(Q * e.asDiagonal() * Q.transpose(), floored);
  };
  bool below = false, above = true;
  const Matrix6 difference = inverse(-1e-9, below) - inverse(1e-9, above);
  EXPECT_TRUE(below);
  EXPECT_FALSE(above);
  EXPECT_LT(difference.norm(), 1e-4);
}

}  // namespace
}  // namespace multipanda::task_space_test
