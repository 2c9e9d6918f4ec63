#include "backends/simulated_arm/inverse_kinematics.hpp"

#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

namespace multipanda {
namespace {

constexpr Eigen::Index kElbowJoint = 2;  // q3
constexpr std::size_t kElbowArm = 7;     // joints of an arm that has an elbow

}  // namespace

Elbow elbow_of(const JointVector& q) {
  if (static_cast<std::size_t>(q.size()) != kElbowArm) return {0, 0};
  const double side = q[3] > kElbowFlip ? 1 : (q[3] < kElbowFlip ? -1 : 0);
  return {q[kElbowJoint], side};
}

JointVector InverseKinematics::joint_motion(const TaskVector& error) const {
  const Eigen::Index m = error.size(), n = J_.cols();
  TaskMatrix A(m, n);
  A.topRows<6>() = J_;
  if (m == 7) {
    A.row(6).setZero();
    A(6, kElbowJoint) = 1;
  }
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, 7, 7> S =
      A.lazyProduct(A.transpose());
  S.diagonal().array() += kDamping * kDamping;
  const TaskVector y = S.llt().solve(error);
  return A.transpose().lazyProduct(y);
}

const InverseKinematics::Solution& InverseKinematics::solve(const Pose& X_BE, std::optional<double> elbow,
                                                            const JointVector& q_guess) {
  with_elbow_ = elbow.has_value() && chain_.joint_count() == kElbowArm;
  solution_.q = q_guess;
  solution_.met = false;
  TaskVector error(with_elbow_ ? 7 : 6);
  for (solution_.rounds = 0;; ++solution_.rounds) {
    const Pose X = chain_.X_BE(solution_.q, J_);
    error.head<6>() = pose_error(X_BE, X);
    if (with_elbow_) error[6] = *elbow - solution_.q[kElbowJoint];
    solution_.error = error.lpNorm<Eigen::Infinity>();
    solution_.met = solution_.error < kClosure;
    if (solution_.met || solution_.rounds == kMostRounds) return solution_;
    JointVector dq = joint_motion(error);
    const double largest = dq.lpNorm<Eigen::Infinity>();
    if (largest > kLargestStep) dq *= kLargestStep / largest;
    solution_.q += dq;
  }
}

JointVector InverseKinematics::differential(const Vector6& dX, double delbow) const {
  TaskVector motion(with_elbow_ ? 7 : 6);
  motion.head<6>() = dX;
  if (with_elbow_) motion[6] = delbow;
  return joint_motion(motion);
}

bool InverseKinematics::singular(const JointVector& q) const {
  constexpr double kLength = 0.3;  // an arm's typical lever [m]
  Jacobian J;
  chain_.X_BE(q, J);
  J.topRows<3>() /= kLength;
  const Matrix6 JJt = J.lazyProduct(J.transpose());
  const double least = Eigen::SelfAdjointEigenSolver<Matrix6>(JJt, Eigen::EigenvaluesOnly).eigenvalues()[0];
  return !(std::sqrt(std::max(0.0, least)) >= kSingular);
}

}  // namespace multipanda
