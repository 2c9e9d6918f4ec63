#include "core/controllets/task_spring.hpp"

#include <numbers>

namespace multipanda {

TaskStiffness TaskStiffness::along(const Matrix3& R_W_axes, const Vector3& translation,
                                   const Vector3& rotation) {
  return {R_W_axes * translation.asDiagonal() * R_W_axes.transpose(),
          R_W_axes * rotation.asDiagonal() * R_W_axes.transpose()};
}

Matrix6 TaskStiffness::matrix() const {
  Matrix6 K = Matrix6::Zero();
  K.topLeftCorner<3, 3>() = translation;
  K.bottomRightCorner<3, 3>() = rotation;
  return K;
}

FadedRotation::FadedRotation(const Vector3& r) : value(r), dvalue_dr(Matrix3::Identity()) {
  const double theta = r.norm();
  const double beyond = theta - kFadeFrom;
  if (beyond <= 0) return;
  // Beyond kFadeFrom psi is a parabola, with slope 1 at kFadeFrom and 0 at pi.
  constexpr double kRange = std::numbers::pi - kFadeFrom;
  const double psi = theta - 0.5 * beyond * beyond / kRange;
  const double slope = 1.0 - beyond / kRange;
  const Vector3 n = r / theta;
  value = psi * n;
  dvalue_dr = psi / theta * Matrix3::Identity() + (slope - psi / theta) * n * n.transpose();
}

double spring_energy(const TaskStiffness& stiffness, const Vector6& error) {
  const Vector3 p = error.head<3>();
  const Vector3 r = FadedRotation(error.tail<3>()).value;
  return 0.5 * p.dot(stiffness.translation * p) + 0.5 * r.dot(stiffness.rotation * r);
}

Vector6 spring_wrench(const TaskStiffness& stiffness, const Vector6& error) {
  const Vector3 r = error.tail<3>();
  const FadedRotation faded(r);
  Vector6 wrench;
  wrench.head<3>() = stiffness.translation * error.head<3>();
  // R' = exp(omega dt) R turns r into r - J_r(r)^-1 omega dt, and J_r(r)^-T = J_l(r)^-1.
  wrench.tail<3>() = inverse_left_jacobian(r) * (faded.dvalue_dr * (stiffness.rotation * faded.value));
  return wrench;
}

Matrix3 inverse_left_jacobian(const Vector3& r) {
  const double theta2 = r.squaredNorm();
  const Matrix3 S = skew(r);
  // (1 - theta/2 cot(theta/2)) / theta^2; a series where the difference loses digits.
  double a = 1.0 / 12.0 + theta2 / 720.0;
  if (theta2 > 1e-4) {
    const double half = 0.5 * std::sqrt(theta2);
    a = (1.0 - half * std::cos(half) / std::sin(half)) / theta2;
  }
  return Matrix3::Identity() - 0.5 * S + a * S * S;
}

}  // namespace multipanda
