#pragma once

#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

// The operational space of one arm at E, world axes (Khatib 1987).
// A = J M^-1 J^T is singular at singular poses. Lambda = A^-1 would reach 175 kg near the stretched elbow. So
// the eigenvalues of A are raised to at least kMobilityFloor, and Lambda is the inverse of the result. Away
// from singular poses no eigenvalue is raised and Lambda is the exact inverse.
struct TaskSpace {
  static constexpr double kMobilityFloor = 0.02;  // [1/kg, 1/(kg m^2)]: no direction heavier than 50 kg

  Matrix6 mobility;      // A = J M^-1 J^T, before the floor
  Matrix6 Lambda;        // (6 x 6) [kg, kg m^2]
  JointBy6 J_bar;        // M^-1 J^T Lambda, dynamically consistent inverse (n x 6)
  bool floored = false;  // an eigenvalue of A was below the floor

  // Where the floor acts, J_bar^T tau is less than the force at the hand: near the stretched elbow an arm
  // acts like a toggle press. Press * (J_bar^T tau) = A^-1 J M^-1 tau is the wrench (6 x 1) [N, N m] on
  // whatever holds the hand, with the eigenvalues of A raised to kPressFloor only. The identity
  // unless `floored`.
  static constexpr double kPressFloor = 1e-4;
  Matrix6 press() const;

  // N x = x - J^T (J_bar^T x): the part of a joint torque that exerts no force at E, (n x 1) [N m].
  JointVector null_space_torque(const Jacobian& J, const JointVector& tau) const;
  // N^T x = x - J_bar (J x): the part of a joint velocity that does not move the task, (n x 1).
  JointVector null_space_velocity(const Jacobian& J, const JointVector& dq) const;
};

// Eigenvalues of a symmetric matrix, in ascending order; one solver, because each takes seconds to compile.
Vector6 eigenvalues(const Matrix6& A);

// Inverse of the symmetric positive semi-definite A with its eigenvalues raised to kMobilityFloor. If A is
// not finite, neither is the result.
Matrix6 floored_inverse(const Matrix6& A, bool& floored);

// Fills `task` from J (6 x n) and M (n x n). Does not allocate.
void compute_task_space(const Jacobian& J, const JointMatrix& M, TaskSpace& task);

// The manipulability m = sqrt(det(J J^T)), the volume of the ellipsoid of velocities at E for unit joint
// velocities (Yoshikawa 1985), and its gradient.
struct Manipulability {
  double value = 0;      // m; meters and radians are mixed, as is usual
  JointVector gradient;  // dm/dq (n x 1) [1/rad]
  // (J J^T + eps 1)^-1 J (6 x n). P = 1 - J^T J_dual projects joint velocities onto those that do not move E.
  // It is symmetric with eigenvalues from 0 to 1.
  Jacobian J_dual;

  JointVector self_motion(const Jacobian& J, const JointVector& dq) const;  // P dq (n x 1)
};

// The gradient in closed form, from the kinematic Hessian of a serial arm,
//   dJ_j/dq_k = [w_k x v_j; w_k x w_j] for k <= j, [w_j x v_k; 0] for k > j,   J_j = [v_j; w_j],
//   dm/dq_k = m tr((J J^T + eps 1)^-1 (dJ/dq_k) J^T),
// in O(n) by prefix sums over the joints. At a singular pose m has a kink, as |x| has at 0. eps = 1e-12
// smooths it: the gradient is zero there. Everywhere it is bounded by the product of the five larger
// singular values of J times the norm of dJ/dq. J = J_V_WE of any arm with revolute and prismatic joints.
// Does not allocate.
void compute_manipulability(const Jacobian& J, Manipulability& result);

}  // namespace multipanda
