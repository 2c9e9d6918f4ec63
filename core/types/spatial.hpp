#pragma once

#include <array>
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
  // Seven numbers as in targets, events and logs: the position, then the quaternion w x y z.
  static Pose from(const double* v) { return from({v[0], v[1], v[2]}, Quaternion(v[3], v[4], v[5], v[6])); }
  std::array<double, 7> values() const {
    const Quaternion q = quaternion();
    return {position.x(), position.y(), position.z(), q.w(), q.x(), q.y(), q.z()};
  }
  Quaternion quaternion() const { return Quaternion(rotation); }
  Pose inverse() const { return {rotation.transpose(), -(rotation.transpose() * position)}; }
};

// The pose with the nearest orthonormal rotation. Single precision deviates by 1e-7, frames that were rounded
// to four digits by 1e-5.
Pose with_proper_rotation(const Pose& X);

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
// Its inverse; pitch within +-pi/2, where only yaw -+ roll is defined and yaw is 0.
Vector3 rpy_of(const Matrix3& R);

// A transform as in messages of the control interface: 4 x 4, column-major.
std::array<double, 16> column_major(const Pose& X);
Pose pose_of(const std::array<double, 16>& column_major);
// A pose as in records: the position, then the rotation, column-major.
inline Pose pose_of(const std::array<double, 12>& values) {
  return {Eigen::Map<const Matrix3>(values.data() + 3), Eigen::Map<const Vector3>(values.data())};
}

// Moves a wrench on a rigid body from point A to point B: the force stays, the moment gains (p_A - p_B) x f.
// All in the same axes. [N, N m]
inline Wrench shifted(const Wrench& F_A, const Vector3& p_BA) {
  Wrench F_B = F_A;
  F_B.torque() += p_BA.cross(F_A.force());
  return F_B;
}

// dJ/dt dr of the left Jacobian J(r) = I + a S(r) + b S(r)^2, a = (1 - cos t)/t^2, b = (t - sin t)/t^3, t =
// |r|: the angular acceleration of exp_rotation(r), in the parent frame, is J(r) ddr plus this term. It
// vanishes if r and dr are parallel, as in a motion from rest to rest.
inline Vector3 left_jacobian_rate(const Vector3& r, const Vector3& dr) {
  const double t2 = r.squaredNorm(), t = std::sqrt(t2), s = r.dot(dr);  // s = t dt/dtime
  double b = 1.0 / 6 - t2 / 120;
  double da = -1.0 / 12 + t2 / 180, db = -1.0 / 60 + t2 / 1260;  // (da/dt)/t, (db/dt)/t
  if (t > 0.05) {
    b = (t - std::sin(t)) / (t2 * t);
    da = (t * std::sin(t) - 2 * (1 - std::cos(t))) / (t2 * t2);
    db = (t * (1 - std::cos(t)) - 3 * (t - std::sin(t))) / (t2 * t2 * t);
  }
  const Vector3 once = r.cross(dr), twice = r.cross(once);
  // d/dt [a S dr + b S S dr] with dr held: a' S dr + a S' dr (= 0) + b' S S dr + b (S' S + S S') dr.
  return s * da * once + s * db * twice + b * dr.cross(once);
}

}  // namespace multipanda
