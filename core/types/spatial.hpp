#pragma once

#include <cmath>

#include <Eigen/Core>
#include <Eigen/Geometry>

// Poses, twists and wrenches. 6-vectors are linear first; see CONVENTIONS.md for names of frames and signs.
namespace multipanda {

using Vector3 = Eigen::Vector3d;
using Matrix3 = Eigen::Matrix3d;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Quaternion = Eigen::Quaterniond;  // named w() x() y() z()

// A rigid transform: X_AB takes coordinates in B to coordinates in A. X_AC = X_AB * X_BC.
struct Pose {
  Matrix3 rotation = Matrix3::Identity();
  Vector3 position = Vector3::Zero();  // [m]

  static Pose from(const Vector3& p, const Quaternion& q) { return {q.normalized().toRotationMatrix(), p}; }
  Quaternion quaternion() const { return Quaternion(rotation); }
  Pose inverse() const { return {rotation.transpose(), -(rotation.transpose() * position)}; }
};

inline Pose operator*(const Pose& X_AB, const Pose& X_BC) {
  return {X_AB.rotation * X_BC.rotation, X_AB.rotation * X_BC.position + X_AB.position};
}
inline Vector3 operator*(const Pose& X_AB, const Vector3& p_B) { return X_AB.rotation * p_B + X_AB.position; }

// [v; omega], [m/s, rad/s]; or its rate, [m/s^2, rad/s^2].
struct Twist {
  Vector6 vector = Vector6::Zero();
  auto linear() { return vector.head<3>(); }
  auto linear() const { return vector.head<3>(); }
  auto angular() { return vector.tail<3>(); }
  auto angular() const { return vector.tail<3>(); }
};

// [f; m], [N, N m].
struct Wrench {
  Vector6 vector = Vector6::Zero();
  auto force() { return vector.head<3>(); }
  auto force() const { return vector.head<3>(); }
  auto torque() { return vector.tail<3>(); }
  auto torque() const { return vector.tail<3>(); }
};

inline Matrix3 skew(const Vector3& a) {
  Matrix3 s;
  s << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return s;
}

// Rotation of angle |r| about r (the exponential map of SO(3)), r in [rad].
Matrix3 exp_rotation(const Vector3& r);

// The rotation vector r with exp_rotation(r) = R and |r| <= pi: the shortest rotation. At exactly pi, one of
// the two.
Vector3 log_rotation(const Matrix3& R);

// Left Jacobian of SO(3): omega (in the parent frame) = left_jacobian(r) * dr/dt for R = exp_rotation(r).
Matrix3 left_jacobian(const Vector3& r);

// e_X_W = [p_d - p; log(R_d R^T)], in world axes: desired minus actual, [m, rad].
Vector6 pose_error(const Pose& X_W_d, const Pose& X_W);

// Roll, pitch, yaw about fixed x, y, z [rad]: R = Rz(yaw) Ry(pitch) Rx(roll), the convention of URDF.
Matrix3 rotation_from_rpy(const Vector3& rpy);

// Moves a wrench on a rigid body from point A to point B: the force stays, the moment gains (p_A - p_B) x f.
// All in the same axes. [N, N m]
inline Wrench shifted(const Wrench& F_A, const Vector3& p_BA) {
  Wrench F_B = F_A;
  F_B.torque() += p_BA.cross(F_A.force());
  return F_B;
}

}  // namespace multipanda
