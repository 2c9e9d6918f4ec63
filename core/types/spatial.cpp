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

}  // namespace multipanda
