#pragma once

#include <cmath>

#include <Eigen/Core>

// Cholesky factors and divisions by them, whole columns at a time. Eigen's LLT and solveInPlace are made for
// large matrices and pack their operands first: for the few rows and columns of an arm that costs more time
// (a cycle of two Cartesian impedances took 12.0 us with solveInPlace, 10.4 us with this), and their blocked
// kernels take half a minute to compile. Any sizes that fit; nothing allocates.
namespace multipanda {

// The factor L of the symmetric A = L L^T (n x n), of which the lower half is read. Only the lower half of L
// is valid. Returns false if A is not positive definite. If A is not finite, neither is L.
template <typename Matrix>
bool cholesky_factor(const Matrix& A, Matrix& L) {
  L = A;
  const Eigen::Index n = L.rows();
  for (Eigen::Index j = 0; j < n; ++j) {
    double* column = &L(0, j);  // plain loops take three quarters of the time of Eigen's blocks
    for (Eigen::Index k = 0; k < j; ++k) {
      const double share = L(j, k), *other = &L(0, k);
      for (Eigen::Index i = j; i < n; ++i) column[i] -= share * other[i];
    }
    if (column[j] <= 0) return false;
    const double scale = 1.0 / std::sqrt(column[j]);
    for (Eigen::Index i = j; i < n; ++i) column[i] *= scale;
  }
  return true;
}

// B := B L^-T, L lower triangular (n x n), B (m x n).
template <typename Lower, typename Matrix>
void divide_by_transposed_lower(const Lower& L, Matrix& B) {
  for (Eigen::Index i = 0; i < B.cols(); ++i) {
    for (Eigen::Index j = 0; j < i; ++j) B.col(i) -= L(i, j) * B.col(j);
    B.col(i) *= 1.0 / L(i, i);
  }
}

// B := B L^-1, L lower triangular (n x n), B (m x n).
template <typename Lower, typename Matrix>
void divide_by_lower(const Lower& L, Matrix& B) {
  for (Eigen::Index i = B.cols() - 1; i >= 0; --i) {
    for (Eigen::Index j = i + 1; j < B.cols(); ++j) B.col(i) -= L(j, i) * B.col(j);
    B.col(i) *= 1.0 / L(i, i);
  }
}

// x with A x = b, L the factor of A (n x n).
template <typename Lower, typename Vector>
Vector cholesky_solve(const Lower& L, const Vector& b) {
  auto row = b.transpose().eval();
  divide_by_transposed_lower(L, row);
  divide_by_lower(L, row);
  return row.transpose();
}

}  // namespace multipanda
