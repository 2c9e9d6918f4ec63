#pragma once

#include "core/types/spatial.hpp"

// Task spring: a potential on poses, and the wrench that is exactly its gradient.
namespace multipanda {

// Stiffness of a translation and of a rotation, both symmetric and positive semi-definite, world axes.
struct TaskStiffness {
  Matrix3 translation;  // K_t [N/m]
  Matrix3 rotation;     // K_r [N m/rad]

  // Diagonal in the axes R_W_axes.
  static TaskStiffness along(const Matrix3& R_W_axes, const Vector3& translation, const Vector3& rotation);
  Matrix6 matrix() const;  // block diagonal
};

// A rotation vector r = theta n of at most half a turn, faded: r_s = psi(theta) n with psi = theta up to
// kFadeFrom and psi'(pi) = 0. The shortest rotation reverses at theta = pi. The potential 1/2 r_s^T K r_s is
// smooth there, so its torque is continuous. The torque along n vanishes at theta = pi: an unstable
// equilibrium, which every continuous law has somewhere.
struct FadedRotation {
  static constexpr double kFadeFrom = 5.0 / 6.0 * 3.14159265358979323846;  // 150 degrees

  explicit FadedRotation(const Vector3& r);
  Vector3 value;      // r_s
  Matrix3 dvalue_dr;  // G = psi' n n^T + psi/theta (I - n n^T), symmetric
};

// V = 1/2 p~^T K_t p~ + 1/2 r_s^T K_r r_s, p~ = p_d - p, r = log(R_d R^T). [J]
double spring_energy(const TaskStiffness& stiffness, const Vector6& error);

// The wrench [f; m] on the end effector with f^T v + m^T omega = -dV/dt at resting target:
//   f = K_t p~,   m = J_l(r)^-1 G K_r r_s.
// For equal stiffness k about all axes, below kFadeFrom, this is m = k r. `error` is pose_error(X_d, X).
Vector6 spring_wrench(const TaskStiffness& stiffness, const Vector6& error);

// Inverse of left_jacobian(r), for |r| <= pi.
Matrix3 inverse_left_jacobian(const Vector3& r);

}  // namespace multipanda
