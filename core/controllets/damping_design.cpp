#include "core/controllets/damping_design.hpp"

namespace multipanda {

Matrix6 task_damping(const Matrix6& Lambda, const Matrix6& stiffness, double zeta) {
  return coupled_damping(Lambda, stiffness, zeta);
}

JointMatrix joint_damping(const JointMatrix& M, const JointVector& stiffness, double zeta) {
  return coupled_damping(M, JointMatrix(stiffness.asDiagonal()), zeta);
}

JointVector diagonal_damping(const JointMatrix& M, const JointVector& stiffness, double zeta) {
  return 2.0 * zeta * (stiffness.array() * M.diagonal().array()).sqrt().matrix();
}

ParameterSpec damping_of_parameter() {
  return choice_parameter(
      "damping_of", {"error", "velocity"},
      "What D acts on: the set-point's velocity minus the arm's, or the arm's alone, which "
      "then lags by K^-1 D times the set-point's velocity.");
}

}  // namespace multipanda
