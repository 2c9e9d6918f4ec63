#include "core/types/spatial.hpp"

#include <algorithm>

namespace multipanda {

Matrix3 exp_rotation(const Vector3& r) {
  const double angle2 = r.squaredNorm();
  const double angle = std::sqrt(angle2);
  const Matrix3 S = skew(r);
  // Uses a series below 1e-4 rad, where the closed form loses digits in (1 - cos)/angle^2.
  const double a = angle < 1e-4 ? 1.0 - angle2 / 6.0 : std::sin(angle) / angle;
  const double b = angle < 1e-4 ? 0.5 - angle2 / 24.0 : (1.0 - std::cos(angle)) / angle2;
  return Matrix3::Identity() + a * S + b * S * S;
}

Vector3 log_rotation(const Matrix3& R) {
  // The quaternion is well conditioned for every angle, pi included.
  Quaternion q(R);
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const double sine = q.vec().norm();
  if (sine < 1e-8) return 2.0 * q.vec();
  return (2.0 * std::atan2(sine, q.w()) / sine) * q.vec();
}

Matrix3 left_jacobian(const Vector3& r) {
  const double angle2 = r.squaredNorm();
  const double angle = std::sqrt(angle2);
  const Matrix3 S = skew(r);
  const double a = angle < 1e-3 ? 0.5 - angle2 / 24.0 : (1.0 - std::cos(angle)) / angle2;
  const double b = angle < 1e-3 ? 1.0 / 6.0 - angle2 / 120.0 : (angle - std::sin(angle)) / (angle2 * angle);
  return Matrix3::Identity() + a * S + b * S * S;
}

Pose with_proper_rotation(const Pose& X) {
  // Newton's iteration for the orthogonal factor of the polar decomposition; quadratic, from 1e-4.
  Pose nearest = X;
  for (int k = 0; k < 3; ++k) {
    const Matrix3 excess = nearest.rotation.transpose() * nearest.rotation;
    nearest.rotation = nearest.rotation * (1.5 * Matrix3::Identity() - 0.5 * excess);
  }
  return Pose::from(nearest.position, nearest.quaternion());
}

Vector6 pose_error(const Pose& X_W_d, const Pose& X_W) {
  Vector6 e;
  e.head<3>() = X_W_d.position - X_W.position;
  e.tail<3>() = log_rotation(X_W_d.rotation * X_W.rotation.transpose());
  return e;
}

Matrix3 rotation_from_rpy(const Vector3& rpy) {
  return (Eigen::AngleAxisd(rpy.z(), Vector3::UnitZ()) * Eigen::AngleAxisd(rpy.y(), Vector3::UnitY()) *
          Eigen::AngleAxisd(rpy.x(), Vector3::UnitX()))
      .toRotationMatrix();
}

Vector3 rpy_of(const Matrix3& R) {
  const double cos_pitch = std::hypot(R(0, 0), R(1, 0));
  const double pitch = std::atan2(-R(2, 0), cos_pitch);
  if (cos_pitch < 1e-9) return {std::atan2(-R(1, 2), R(1, 1)), pitch, 0.0};
  return {std::atan2(R(2, 1), R(2, 2)), pitch, std::atan2(R(1, 0), R(0, 0))};
}

std::array<double, 16> column_major(const Pose& X) {
  std::array<double, 16> values{};
  Eigen::Map<Eigen::Matrix4d> T(values.data());
  T << X.rotation, X.position, 0, 0, 0, 1;
  return values;
}

Pose pose_of(const std::array<double, 16>& column_major) {
  const Eigen::Map<const Eigen::Matrix4d> T(column_major.data());
  return {T.topLeftCorner<3, 3>(), T.topRightCorner<3, 1>()};
}

}  // namespace multipanda
