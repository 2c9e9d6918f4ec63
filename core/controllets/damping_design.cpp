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

}  // namespace multipanda
