#include "models/rigid_body.hpp"

#include <Eigen/Eigenvalues>

namespace multipanda {
namespace {

// Inertia of a point of mass m at r about the origin (parallel axis theorem).
Matrix3 point_inertia(double mass, const Vector3& r) {
  return mass * (r.squaredNorm() * Matrix3::Identity() - r * r.transpose());
}

}  // namespace

RigidBody moved(const RigidBody& body, const Pose& X_AB) {
  return {body.mass, X_AB * body.com, X_AB.rotation * body.inertia * X_AB.rotation.transpose()};
}

RigidBody merged(const RigidBody& a, const RigidBody& b) {
  RigidBody sum;
  sum.mass = a.mass + b.mass;
  sum.com = (a.mass * a.com + b.mass * b.com) / sum.mass;
  sum.inertia =
      a.inertia + point_inertia(a.mass, a.com - sum.com) + b.inertia + point_inertia(b.mass, b.com - sum.com);
  return sum;
}

bool is_physical(const RigidBody& body) {
  const Matrix3 second_moment = 0.5 * body.inertia.trace() * Matrix3::Identity() - body.inertia;
  const Eigen::SelfAdjointEigenSolver<Matrix3> solver(second_moment, Eigen::EigenvaluesOnly);
  return body.mass > 0 && solver.eigenvalues().minCoeff() > 0;
}

}  // namespace multipanda
