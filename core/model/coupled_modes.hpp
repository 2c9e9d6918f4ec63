#pragma once

#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

// The natural modes of an inertia and a stiffness that are both full matrices (n x n), the inertia symmetric
// positive definite, the stiffness symmetric positive semi-definite:
//   inertia = L L^T,   stiffness = L U diag(k) U^T L^T,   U orthogonal.
// Nothing allocates. If an argument is not finite, neither is the result. Available for the sizes below only:
// Eigen's solver takes seconds to compile for each.
template <typename Matrix>
struct CoupledModes {
  using Vector =
      Eigen::Matrix<double, Matrix::RowsAtCompileTime, 1, Eigen::ColMajor, Matrix::MaxRowsAtCompileTime, 1>;
  CoupledModes(const Matrix& inertia, const Matrix& stiffness);

  Matrix L;  // lower triangular
  Matrix U;
  Vector k;  // not negative [1/s^2]
};

using Matrix7 = Eigen::Matrix<double, 7, 7>;
using Matrix12 = Eigen::Matrix<double, 12, 12>;
extern template struct CoupledModes<Matrix6>;
extern template struct CoupledModes<Matrix7>;
extern template struct CoupledModes<Matrix12>;
extern template struct CoupledModes<JointMatrix>;

}  // namespace multipanda
