#pragma once

#include <vector>

#include "core/testing/test_arm.hpp"

namespace multipanda::test {

// Textbook kinematics and dynamics of a TestArm: geometric Jacobian, M from the kinetic energies of the
// bodies, C dq by Christoffel symbols of a numerical derivative of M. Slow, and independent of the library
// that the core uses. Dynamic sizes, world axes.
class PlainArm {
 public:
  PlainArm(TestArm arm, Pose X_WB, Pose X_FE = {});

  std::size_t joint_count() const { return arm_.links.size(); }
  Pose end_effector(const Eigen::VectorXd& q) const;
  Eigen::MatrixXd jacobian(const Eigen::VectorXd& q) const;        // of E's origin, linear first
  Vector3 elbow(const Eigen::VectorXd& q) const;                   // origin of the middle joint
  Eigen::MatrixXd elbow_jacobian(const Eigen::VectorXd& q) const;  // (3 x n)
  Eigen::MatrixXd mass(const Eigen::VectorXd& q) const;
  Eigen::VectorXd coriolis(const Eigen::VectorXd& q, const Eigen::VectorXd& dq) const;  // C dq

 private:
  std::vector<Pose> joints(const Eigen::VectorXd& q) const;
  Eigen::MatrixXd point_jacobian(const std::vector<Pose>& X_WJ, std::size_t body, const Vector3& p_W) const;
  TestArm arm_;
  Pose X_WB_, X_FE_;
};

}  // namespace multipanda::test
