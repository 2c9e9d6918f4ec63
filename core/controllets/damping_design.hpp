#pragma once

#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"
#include "core/types/triangular.hpp"

// Damping of an inertia and a stiffness that are both full matrices. With the generalised eigenvalues k of
// (stiffness, inertia), that is inertia = Q Q^T and stiffness = Q diag(k) Q^T,
//   damping = 2 zeta Q diag(sqrt(k)) Q^T
// gives every coupled mode the damping ratio zeta (Albu-Schaeffer et al., ICRA 2003). The result is symmetric
// and positive semi-definite whatever the arguments, so it only ever takes energy out. A mode without
// stiffness has no damping either.
namespace multipanda {

// inertia symmetric positive definite, stiffness symmetric positive semi-definite (n x n), of a fixed size or
// with inline storage: nothing allocates. Not finite: the result is not finite either.
template <typename Matrix>
Matrix coupled_damping(const Matrix& inertia, const Matrix& stiffness, double zeta) {
  // inertia = L L^T; L^-1 stiffness L^-T = U diag(k) U^T; Q = L U.
  const Eigen::LLT<Matrix> cholesky(inertia);
  Matrix S = stiffness;
  divide_by_transposed_lower(cholesky.matrixLLT(), S);
  S.transposeInPlace();
  divide_by_transposed_lower(cholesky.matrixLLT(), S);
  const Eigen::SelfAdjointEigenSolver<Matrix> modes(S);
  // Rounding may leave a mode without stiffness slightly below zero.
  const auto d = (2.0 * zeta * modes.eigenvalues().cwiseMax(0.0).cwiseSqrt()).eval();
  const Matrix L = cholesky.matrixL();
  const Matrix Q = L.lazyProduct(modes.eigenvectors());
  return (Q * d.asDiagonal()).lazyProduct(Q.transpose());
}

// The same for a task, linear first: [N s/m, N m s/rad] from [kg, kg m^2] and [N/m, N m/rad].
Matrix6 task_damping(const Matrix6& Lambda, const Matrix6& stiffness, double zeta);

// The same for joints, with diagonal stiffness (n x 1) [N m/rad]: (n x n) [N m s/rad].
JointMatrix joint_damping(const JointMatrix& M, const JointVector& stiffness, double zeta);

// Each joint alone: d_i = 2 zeta sqrt(k_i M_ii), (n x 1) [N m s/rad]. Cheaper; exact only where M is
// diagonal.
JointVector diagonal_damping(const JointMatrix& M, const JointVector& stiffness, double zeta);

}  // namespace multipanda
