#include "core/testing/plain_arm.hpp"

namespace multipanda::test {

PlainArm::PlainArm(TestArm arm, Pose X_WB, Pose X_FE) : arm_(std::move(arm)), X_WB_(X_WB), X_FE_(X_FE) {}

std::vector<Pose> PlainArm::joints(const Eigen::VectorXd& q) const {
  std::vector<Pose> poses;
  Pose X = X_WB_;
  for (std::size_t i = 0; i < arm_.links.size(); ++i) {
    const TestLink& link = arm_.links[i];
    const Eigen::AngleAxisd turn(q[static_cast<Eigen::Index>(i)], link.axis);
    X = X * link.X_PJ * Pose{turn.toRotationMatrix(), Vector3::Zero()};
    poses.push_back(X);
  }
  return poses;
}

Pose PlainArm::end_effector(const Eigen::VectorXd& q) const { return joints(q).back() * arm_.X_JF * X_FE_; }

Eigen::MatrixXd PlainArm::point_jacobian(const std::vector<Pose>& X_WJ, std::size_t body,
                                         const Vector3& p_W) const {
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(6, static_cast<Eigen::Index>(X_WJ.size()));
  for (std::size_t i = 0; i <= body; ++i) {
    const Vector3 axis = X_WJ[i].rotation * arm_.links[i].axis;
    J.col(static_cast<Eigen::Index>(i)) << axis.cross(p_W - X_WJ[i].position), axis;
  }
  return J;
}

Eigen::MatrixXd PlainArm::jacobian(const Eigen::VectorXd& q) const {
  return point_jacobian(joints(q), joint_count() - 1, end_effector(q).position);
}

Vector3 PlainArm::elbow(const Eigen::VectorXd& q) const { return joints(q)[joint_count() / 2].position; }

Eigen::MatrixXd PlainArm::elbow_jacobian(const Eigen::VectorXd& q) const {
  return point_jacobian(joints(q), joint_count() / 2, elbow(q)).topRows(3);
}

Eigen::MatrixXd PlainArm::mass(const Eigen::VectorXd& q) const {
  const auto X_WJ = joints(q);
  Eigen::MatrixXd M = Eigen::MatrixXd::Zero(q.size(), q.size());
  for (std::size_t i = 0; i < joint_count(); ++i) {
    const TestLink& link = arm_.links[i];
    const Eigen::MatrixXd J = point_jacobian(X_WJ, i, X_WJ[i] * link.p_JC);
    const Matrix3 I = X_WJ[i].rotation * link.inertia_C * X_WJ[i].rotation.transpose();
    M += link.mass * J.topRows(3).transpose() * J.topRows(3) +
         J.bottomRows(3).transpose() * I * J.bottomRows(3);
  }
  return M;
}

Eigen::VectorXd PlainArm::coriolis(const Eigen::VectorXd& q, const Eigen::VectorXd& dq) const {
  constexpr double h = 1e-5;
  const Eigen::Index n = q.size();
  Eigen::VectorXd c = Eigen::VectorXd::Zero(n);
  for (Eigen::Index k = 0; k < n; ++k) {
    Eigen::VectorXd step = Eigen::VectorXd::Zero(n);
    step[k] = h;
    const Eigen::MatrixXd dM = (mass(q + step) - mass(q - step)) / (2 * h);
    c += dM * dq * dq[k];
    c[k] -= 0.5 * dq.dot(dM * dq);
  }
  return c;
}

}  // namespace multipanda::test
