// The elbow: its velocity by finite differences of kinematics written independently, and what presses on
// something that holds it, from the equations of motion with that constraint.
#include <gtest/gtest.h>

#include "core/controllets/joint_law.hpp"
#include "core/testing/controllet_rig.hpp"
#include "core/testing/dense_algebra.hpp"
#include "core/testing/plain_arm.hpp"

namespace multipanda::elbow_test {
namespace {

using namespace test;

TEST(Elbow, MovesWithTheMiddleJoint) {
  Draw draw(41);
  const Pose X_WB{draw.rotation(), Vector3(0.3, -0.2, 0.1)};
  const TestArm arm = TestArm::make(7);
  const PlainArm plain(arm, X_WB);
  ModelTerms terms(arm.model(X_WB));
  for (int k = 0; k < 20; ++k) {
    const JointVector q = bent(7) + draw.joints(7, 0.5), dq = draw.joints(7, 1);
    terms.update(q, dq);
    constexpr double h = 1e-6;
    const Vector3 v = (plain.elbow(q + h * dq) - plain.elbow(q - h * dq)) / (2 * h);
    EXPECT_GT(v.norm(), 1e-3);
    EXPECT_LT((Elbow(terms).velocity(dq) - v).norm(), 1e-7);
  }
}

// M ddq + J^T f = tau, J ddq = d f: f is what presses, and d yields a little.
TEST(Elbow, PressesOnWhatHoldsIt) {
  Draw draw(42);
  const Pose X_WB{draw.rotation(), Vector3(0.3, -0.2, 0.1)};
  const TestArm arm = TestArm::make(7);
  const PlainArm plain(arm, X_WB);
  ModelTerms terms(arm.model(X_WB));
  for (int k = 0; k < 20; ++k) {
    const JointVector q = bent(7) + draw.joints(7, 0.5), tau = draw.joints(7, 30);
    terms.update(q, JointVector::Zero(7));
    const Eigen::MatrixXd J = plain.elbow_jacobian(q);
    Eigen::MatrixXd K(10, 10);
    K << plain.mass(q), J.transpose(), J, -0.005 * Eigen::MatrixXd::Identity(3, 3);
    Eigen::VectorXd right(10);
    right << tau, Eigen::Vector3d::Zero();
    const Eigen::VectorXd solved = K.fullPivLu().solve(right);
    EXPECT_LT((Elbow(terms).force(tau) - solved.tail<3>()).norm(), 1e-5 * (1 + solved.tail<3>().norm()));
  }
}

}  // namespace
}  // namespace multipanda::elbow_test
