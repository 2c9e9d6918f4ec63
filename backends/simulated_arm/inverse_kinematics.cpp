#include "backends/simulated_arm/inverse_kinematics.hpp"

#include <cmath>

#include <Eigen/Cholesky>

#include "core/model/model_terms.hpp"
#include "core/model/task_space.hpp"
#include "core/types/rotation_between.hpp"

namespace multipanda {
namespace {

// Appends a rotation of q about z, which changes only the first two columns.
void turn_about_z(Matrix3& R, double q) {
  const double c = std::cos(q), s = std::sin(q);
  const Vector3 x = R.col(0), y = R.col(1);
  R.col(0) = c * x + s * y;
  R.col(1) = c * y - s * x;
}

// Appends the motion of a joint by q along or about z.
void move(Pose& X, bool slides, double q) {
  if (slides) {
    X.position += q * X.rotation.col(2);
  } else {
    turn_about_z(X.rotation, q);
  }
}

constexpr Eigen::Index kElbowJoint = 2;  // q3
constexpr std::size_t kElbowArm = 7;     // joints of an arm that has an elbow

}  // namespace

KinematicChain::KinematicChain(const std::shared_ptr<const ArmModel>& model)
    : joint_count_(model->joint_count()) {
  ModelTerms terms(model);
  const JointVector zero = joint_constant(joint_count_, 0);
  terms.set_config({}, {}, {});
  terms.update(zero, zero);
  const Jacobian J = terms.J_V_WE();
  Pose X_WP = model->X_WB();
  for (std::size_t i = 0; i < joint_count_; ++i) {
    const Pose X_WJ = terms.X_WJ(i);
    slides_[i] = model->is_prismatic(i);
    const auto column = J.col(static_cast<Eigen::Index>(i));
    const Vector3 axis_W = (slides_[i] ? column.head<3>() : column.tail<3>()).normalized();
    const Vector3 axis_J = X_WJ.rotation.transpose() * axis_W;
    const Pose X_JT{rotation_between(Vector3::UnitZ(), axis_J).toRotationMatrix(), Vector3::Zero()};
    const Pose X_WT = X_WJ * X_JT;
    X_PT_[i] = X_WP.inverse() * X_WT;
    X_WP = X_WT;
  }
  X_TF_ = X_WP.inverse() * terms.X_WF();
  X_TE_ = X_TF_;
}

Pose KinematicChain::X_BE(const JointVector& q) const {
  Pose X;
  for (std::size_t i = 0; i < joint_count_; ++i) {
    X = X * X_PT_[i];
    move(X, slides_[i], q[static_cast<Eigen::Index>(i)]);
  }
  return X * X_TE_;
}

Pose KinematicChain::X_BE(const JointVector& q, Jacobian& J_V_BE) const {
  J_V_BE.resize(6, static_cast<Eigen::Index>(joint_count_));
  std::array<Vector3, kMaxJoints> origin;
  Pose X;
  for (std::size_t i = 0; i < joint_count_; ++i) {
    const auto column = static_cast<Eigen::Index>(i);
    X = X * X_PT_[i];
    move(X, slides_[i], q[column]);
    origin[i] = X.position;
    J_V_BE.col(column).tail<3>() = X.rotation.col(2);
  }
  X = X * X_TE_;
  for (std::size_t i = 0; i < joint_count_; ++i) {
    const auto column = static_cast<Eigen::Index>(i);
    const Vector3 axis = J_V_BE.col(column).tail<3>();
    if (slides_[i]) {
      J_V_BE.col(column) << axis, Vector3::Zero();
    } else {
      J_V_BE.col(column).head<3>() = axis.cross(X.position - origin[i]);
    }
  }
  return X;
}

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
  Jacobian J;
  chain_.X_BE(q, J);
  const Matrix6 JJt = J.lazyProduct(J.transpose());
  const double least = eigenvalues(JJt)[0];
  return !(std::sqrt(std::max(0.0, least)) >= kSingular);
}

}  // namespace multipanda
