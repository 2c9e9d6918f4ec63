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

  // Where the floor acts, J_bar^T tau is less than what the hand presses with: near the stretched elbow an
  // arm is a toggle press. Press * (J_bar^T tau) = A^-1 J M^-1 tau is the wrench (6 x 1) [N, N m] on whatever
  // holds the hand, with the eigenvalues of A raised to kPressFloor only. The identity unless `floored`.
  static constexpr double kPressFloor = 1e-4;
  Matrix6 press() const;

  // N x = x - J^T (J_bar^T x): the part of a joint torque that exerts no force at E, (n x 1) [N m].
  JointVector null_space_torque(const Jacobian& J, const JointVector& tau) const;
  // N^T x = x - J_bar (J x): the part of a joint velocity that does not move the task, (n x 1).
  JointVector null_space_velocity(const Jacobian& J, const JointVector& dq) const;
};

// Inverse of the symmetric positive semi-definite A with its eigenvalues raised to kMobilityFloor. If A is
// not finite, neither is the result.
Matrix6 floored_inverse(const Matrix6& A, bool& floored);

// Fills `task` from J (6 x n) and M (n x n). Does not allocate.
void compute_task_space(const Jacobian& J, const JointMatrix& M, TaskSpace& task);

}  // namespace multipanda
