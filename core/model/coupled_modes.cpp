#include "core/model/coupled_modes.hpp"

#include <Eigen/Eigenvalues>

#include "core/types/triangular.hpp"

namespace multipanda {

template <typename Matrix>
CoupledModes<Matrix>::CoupledModes(const Matrix& inertia, const Matrix& stiffness) : U(stiffness) {
  cholesky_factor(inertia, L);
  L.template triangularView<Eigen::StrictlyUpper>().setZero();
  divide_by_transposed_lower(L, U);
  U.transposeInPlace();
  divide_by_transposed_lower(L, U);
  const Eigen::SelfAdjointEigenSolver<Matrix> solver(U);
  U = solver.eigenvectors();
  k = solver.eigenvalues().cwiseMax(0.0);  // rounding may leave a mode without stiffness slightly below zero
}

template struct CoupledModes<Matrix6>;
template struct CoupledModes<Matrix7>;
template struct CoupledModes<Matrix12>;
template struct CoupledModes<JointMatrix>;

}  // namespace multipanda
