#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

namespace multipanda {

// Covariance of least squares for stationary residuals that are correlated in time and across joints:
//   cov = B M B,  M = sum_ij sum_l r_ij(l) sum_t a_i(t)^T a_j(t + l),  B = (sum_j A_j^T A_j)^-1
// r_ij: the residuals' covariances at lag l, with a flat-top window whose width follows from the
// data (Politis, J. Nonparametric Statistics 2003), corrected for the part that the fit absorbed at
// its columns' frequencies.
struct ResidualBlock {
  std::vector<Eigen::MatrixXd> rows;  // A_j, weighted, one per joint (N x p)
  Eigen::MatrixXd residual;           // weighted (N x n)
};

// Blocks are unbroken stretches (logs). `longest_lag` receives the window's half width [samples].
Eigen::MatrixXd correlated_covariance(std::span<const ResidualBlock> blocks, const Eigen::MatrixXd& B,
                                      Eigen::Index* longest_lag = nullptr);

}  // namespace multipanda
