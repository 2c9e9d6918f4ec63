#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// The elbow of an arm, the origin of its middle joint: what moves and presses there in the null space of the
// hand. Or another point p_W of the link behind `joint`, as the hand of an arm that stands there. World axes.
// Loop thread, no allocation.
class Elbow {
 public:
  explicit Elbow(ModelTerms& terms);
  Elbow(ModelTerms& terms, std::size_t joint, const Vector3& p_W);
  Vector3 velocity(const JointVector& dq) const { return J_.lazyProduct(dq); }  // (3 x 1) [m/s]
  // What a joint torque tau presses with on something that holds the elbow: A^-1 J M^-1 tau, A = J M^-1 J^T
  // (Khatib 1987), (3 x 1) [N]. The force is less where the elbow hardly moves, A + kDamping I in place of A.
  Vector3 force(const JointVector& tau) const;

 private:
  void see_inertia(ModelTerms& terms, double damping);
  static constexpr double kDamping = 0.005;  // [1/kg]
  // A torso of 10 kg m^2 has 0.01 1/kg at 0.3 m: 5 % more than the bound may act there.
  static constexpr double kDampingOfPoint = 0.0005;

  Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, kMaxJoints> J_;    // (3 x n)
  Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, kMaxJoints> J_M_;  // J M^-1 (3 x n)
  Matrix3 inertia_;                                                               // (A + kDamping I)^-1
};

}  // namespace multipanda
