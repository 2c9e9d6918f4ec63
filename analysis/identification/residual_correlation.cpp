#include "analysis/identification/residual_correlation.hpp"

#include <algorithm>
#include <cmath>

namespace multipanda {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index kMostLags = 200;

// r_ij(l) = mean over t of e_i(t) e_j(t + l), for l = 0 .. lags.
VectorXd covariances(std::span<const ResidualBlock> blocks, Index i, Index j, Index lags) {
  VectorXd sum = VectorXd::Zero(lags + 1);
  Index count = 0;
  for (const ResidualBlock& block : blocks) {
    const Index N = block.residual.rows();
    count += N;
    for (Index l = 0; l <= std::min(lags, N - 1); ++l) {
      sum[l] += block.residual.col(i).head(N - l).dot(block.residual.col(j).tail(N - l));
    }
  }
  return sum / static_cast<double>(std::max<Index>(1, count));
}

// First lag after which several correlations in a row are not told from zero.
Index correlation_length(const VectorXd& r, double count) {
  constexpr Index kInARow = 8;
  const double bound = 2 * std::sqrt(std::log10(std::max(10.0, count)) / count);
  Index quiet = 0;
  for (Index l = 1; l < r.size(); ++l) {
    quiet = std::abs(r[l]) < bound * r[0] ? quiet + 1 : 0;
    if (quiet == kInARow) return std::max<Index>(1, l - kInARow + 1);
  }
  return r.size() / 2;
}

// 1 up to half the width, then falling to 0.
double flat_top(Index lag, Index width) {
  const double x = static_cast<double>(lag) / static_cast<double>(width);
  return std::clamp(2 * (1 - x), 0.0, 1.0);
}

}  // namespace

MatrixXd correlated_covariance(std::span<const ResidualBlock> blocks, const MatrixXd& B, Index* longest_lag) {
  const Index n = blocks.front().residual.cols(), p = B.cols();
  double count = 0;
  Index shortest = kMostLags;
  for (const ResidualBlock& block : blocks) {
    count += static_cast<double>(block.residual.rows());
    shortest = std::min(shortest, block.residual.rows() / 4);
  }
  Index widest = 0;
  // Widths per joint; a pair of joints has the larger one.
  std::vector<Index> width(static_cast<std::size_t>(n));
  std::vector<VectorXd> own;
  for (Index j = 0; j < n; ++j) {
    own.push_back(covariances(blocks, j, j, shortest));
    const Index length = correlation_length(own.back(), count);
    width[static_cast<std::size_t>(j)] = std::min(shortest, 2 * length);
    widest = std::max(widest, width[static_cast<std::size_t>(j)]);
  }
  if (longest_lag != nullptr) *longest_lag = widest;

  // A_i^T R_ij A_j summed over blocks, for lags of both signs. `raw`: before the correction below.
  const auto product = [&](Index i, Index j) {
    const Index lags = std::max(width[static_cast<std::size_t>(i)], width[static_cast<std::size_t>(j)]);
    const VectorXd forward = covariances(blocks, i, j, lags), backward = covariances(blocks, j, i, lags);
    MatrixXd sum = MatrixXd::Zero(p, p);
    for (const ResidualBlock& block : blocks) {
      const MatrixXd& Ai = block.rows[static_cast<std::size_t>(i)];
      const MatrixXd& Aj = block.rows[static_cast<std::size_t>(j)];
      const Index N = Ai.rows();
      MatrixXd RA = forward[0] * Aj;
      for (Index l = 1; l <= std::min(lags, N - 1); ++l) {
        const double w = flat_top(l, lags + 1);
        RA.topRows(N - l) += w * forward[l] * Aj.bottomRows(N - l);
        RA.bottomRows(N - l) += w * backward[l] * Aj.topRows(N - l);
      }
      sum += Ai.transpose() * RA;
    }
    return sum;
  };

  std::vector<double> larger(static_cast<std::size_t>(n));
  MatrixXd M = MatrixXd::Zero(p, p);
  for (Index j = 0; j < n; ++j) {
    const MatrixXd own_product = product(j, j);
    // The fit takes tr(H R) of the residuals' energy away, H the projection onto its columns.
    const double taken = B.cwiseProduct(own_product.transpose()).sum() / std::max(1e-300, count * own[static_cast<std::size_t>(j)][0]);
    larger[static_cast<std::size_t>(j)] = 1 / (1 - std::clamp(taken, 0.0, 0.8));
    M += larger[static_cast<std::size_t>(j)] * own_product;
  }
  for (Index i = 0; i < n; ++i) {
    for (Index j = i + 1; j < n; ++j) {
      const VectorXd& ri = own[static_cast<std::size_t>(i)];
      const VectorXd& rj = own[static_cast<std::size_t>(j)];
      const double together = covariances(blocks, i, j, 0)[0] / std::sqrt(std::max(1e-300, ri[0] * rj[0]));
      const double independent = count / std::max(1.0, ri.cwiseAbs2().sum() * 2 / std::max(1e-300, ri[0] * ri[0]) - 1);
      if (std::abs(together) < 3 / std::sqrt(std::max(1.0, independent))) continue;
      const MatrixXd cross = product(i, j);
      M += std::sqrt(larger[static_cast<std::size_t>(i)] * larger[static_cast<std::size_t>(j)]) *
           (cross + cross.transpose());
    }
  }
  return B * M * B;
}

}  // namespace multipanda
