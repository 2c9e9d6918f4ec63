#include "core/controllets/elbow.hpp"

namespace multipanda {

Elbow::Elbow(ModelTerms& terms) {
  const std::size_t middle = terms.joint_count() / 2;
  J_.setZero(3, static_cast<Eigen::Index>(terms.joint_count()));
  if (middle > 0) terms.point_jacobian(middle - 1, terms.X_WJ(middle).position, J_);
  see_inertia(terms, kDamping);
}

Elbow::Elbow(ModelTerms& terms, std::size_t joint, const Vector3& p_W) {
  J_.setZero(3, static_cast<Eigen::Index>(terms.joint_count()));
  terms.point_jacobian(joint, p_W, J_);
  see_inertia(terms, kDampingOfPoint);
}

void Elbow::see_inertia(ModelTerms& terms, double damping) {
  J_M_.setZero(3, J_.cols());
  const Eigen::LLT<JointMatrix> M(terms.M());
  for (Eigen::Index row = 0; row < 3; ++row) J_M_.row(row) = M.solve(JointVector(J_.row(row))).transpose();
  const Matrix3 A = J_M_.lazyProduct(J_.transpose());
  inertia_ = (A + damping * Matrix3::Identity()).inverse();
}

Vector3 Elbow::force(const JointVector& tau) const { return inertia_ * Vector3(J_M_.lazyProduct(tau)); }

}  // namespace multipanda
