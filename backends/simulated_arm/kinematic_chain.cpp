#include "backends/simulated_arm/kinematic_chain.hpp"

#include <cmath>

#include "core/model/model_terms.hpp"

namespace multipanda {
namespace {

// Appends a rotation of q about z, in which only the first two columns change.
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
    const Pose X_JT{Quaternion::FromTwoVectors(Vector3::UnitZ(), axis_J).toRotationMatrix(), Vector3::Zero()};
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

}  // namespace multipanda
