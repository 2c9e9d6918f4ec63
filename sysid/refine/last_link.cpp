#include "sysid/refine/last_link.hpp"

#include <cmath>

#include <Eigen/Eigenvalues>

#include "scene/build.hpp"

namespace multipanda {
namespace {

// Removes a part from a body in the link's frame, by adding it with negative mass.
RigidBody without(const RigidBody& whole, const RigidBody& part) {
  return merged(whole, {-part.mass, part.com, -part.inertia});
}

// Identified links are often at the limit of physical consistency. This is the smallest change of
// inertia that makes one possible, with mass and center unchanged. Sigma = tr(I)/2 1 - I is the second moment
// of mass.
RigidBody nearest_physical(const RigidBody& body) {
  if (is_physical(body)) return body;
  constexpr double kThinnest = 1e-3;  // smallest spread of the mass along any direction [m]
  const Eigen::SelfAdjointEigenSolver<Matrix3> solver(0.5 * body.inertia.trace() * Matrix3::Identity() -
                                                      body.inertia);
  const Vector3 moments = solver.eigenvalues().cwiseMax(body.mass * kThinnest * kThinnest);
  const Matrix3 sigma = solver.eigenvectors() * moments.asDiagonal() * solver.eigenvectors().transpose();
  return {body.mass, body.com, sigma.trace() * Matrix3::Identity() - sigma};
}

// The inverse of Placement::pose().
Vector3 rpy_of(const Matrix3& R) {
  return {std::atan2(R(2, 1), R(2, 2)), std::atan2(-R(2, 0), std::hypot(R(2, 1), R(2, 2))),
          std::atan2(R(1, 0), R(0, 0))};
}

}  // namespace

RobotDescription with_flange(const RobotDescription& robot, const SceneArm& arm, const Pose& X_LF) {
  const Pose before = robot.flange.pose();
  RigidBody last = robot.links.back();
  const auto shift = [&](const RigidBody& body, const Pose& X_F) {
    last = without(merged(last, moved(body, before * X_F)), moved(body, X_LF * X_F));
  };
  if (arm.hand && robot.hand) shift(rigid_hand(*robot.hand), robot.hand->mount.pose());
  if (arm.tool.mass > 0) shift({arm.tool.mass, arm.tool.p_FC, arm.tool.inertia_C}, {});
  RobotDescription result = robot;
  if (last.mass > 0) result.links.back() = nearest_physical(last);
  result.flange.position = X_LF.position;
  // Without a rotation, the values stay exactly the same.
  if ((X_LF.rotation - before.rotation).norm() > 1e-12) result.flange.rpy = rpy_of(X_LF.rotation);
  return result;
}

}  // namespace multipanda
