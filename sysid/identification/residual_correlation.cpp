#include "sysid/identification/residual_correlation.hpp"

#include <algorithm>
#include <cmath>

namespace multipanda {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index kMostLags = 200;
constexpr int kCorrections = 8;  // passes of the correction for the part that the fit absorbed

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

// First lag after which several correlations in a row cannot be distinguished from zero.
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

// Sums over time of x_t . (R x)_(t + l) need R x for a stationary R with covariances r: (N x p).
MatrixXd times_toeplitz(const VectorXd& r, const MatrixXd& x) {
  const Index N = x.rows();
  MatrixXd out = r[0] * x;
  for (Index l = 1; l < std::min(r.size(), N); ++l) {
    out.topRows(N - l) += r[l] * x.bottomRows(N - l);
    out.bottomRows(N - l) += r[l] * x.topRows(N - l);
  }
  return out;
}

// sum over t of a_t . b_(t + l), l = 0 .. lags.
VectorXd lagged_products(const MatrixXd& a, const MatrixXd& b, Index lags) {
  VectorXd out = VectorXd::Zero(lags + 1);
  for (Index l = 0; l <= std::min(lags, a.rows() - 1); ++l) {
    out[l] = a.topRows(a.rows() - l).cwiseProduct(b.bottomRows(b.rows() - l)).sum();
  }
  return out;
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
  // One width per joint; a pair of joints has the larger one.
  std::vector<Index> width(static_cast<std::size_t>(n));
  std::vector<VectorXd> own;
  for (Index j = 0; j < n; ++j) {
    own.push_back(covariances(blocks, j, j, shortest));
    const Index length = correlation_length(own.back(), count);
    width[static_cast<std::size_t>(j)] = std::min(shortest, 2 * length);
    widest = std::max(widest, width[static_cast<std::size_t>(j)]);
  }
  if (longest_lag != nullptr) *longest_lag = widest;

  // Least squares absorbs the part of the noise that the columns can imitate, at their frequencies. There, up
  // to a third is missing in the residuals e = (I - H) noise, H = A B A^T. So this solves for covariances r_j
  // of the noise whose
  //   E[e_j e_j^T] = R_j - A_j B A_j^T R_j - R_j A_j B A_j^T + A_j B (sum_i A_i^T R_i A_i) B A_j^T
  // equals the observed one: r <- r + (observed - expected), a contraction.
  std::vector<VectorXd> seen(static_cast<std::size_t>(n));
  for (Index j = 0; j < n; ++j) {
    VectorXd& r = seen[static_cast<std::size_t>(j)];
    const Index lags = width[static_cast<std::size_t>(j)];
    r = own[static_cast<std::size_t>(j)].head(lags + 1);
    for (Index l = 0; l <= lags; ++l) r[l] *= flat_top(l, lags + 1);
  }
  std::vector<VectorXd> noise = seen;
  std::vector<MatrixXd> own_product(static_cast<std::size_t>(n));  // A_j^T R_j A_j
  for (int pass = 0; pass <= kCorrections; ++pass) {
    // R_j A_j of every block.
    std::vector<std::vector<MatrixXd>> RA(static_cast<std::size_t>(n));
    MatrixXd total = MatrixXd::Zero(p, p);
    for (std::size_t j = 0; j < RA.size(); ++j) {
      own_product[j] = MatrixXd::Zero(p, p);
      for (const ResidualBlock& block : blocks) {
        RA[j].push_back(times_toeplitz(noise[j], block.rows[j]));
        own_product[j] += block.rows[j].transpose() * RA[j].back();
      }
      total += own_product[j];
    }
    if (pass == kCorrections) break;
    const MatrixXd BSB = B * total * B;
    for (std::size_t j = 0; j < RA.size(); ++j) {
      const Index lags = width[j];
      VectorXd expected = count * noise[j];
      // The number of products falls with the lag, as in the observed covariances.
      for (Index l = 0; l <= lags; ++l) {
        double pairs = 0;
        for (const ResidualBlock& block : blocks)
          pairs += static_cast<double>(std::max<Index>(0, block.residual.rows() - l));
        expected[l] = pairs * noise[j][l];
      }
      for (std::size_t b = 0; b < blocks.size(); ++b) {
        const MatrixXd& A = blocks[b].rows[j];
        const MatrixXd AB = A * B;
        expected -= lagged_products(AB, RA[j][b], lags) + lagged_products(RA[j][b], AB, lags);
        expected += lagged_products(A * BSB, A, lags);
      }
      for (Index l = 0; l <= lags; ++l) {
        noise[j][l] += seen[j][l] - flat_top(l, lags + 1) * expected[l] / count;
      }
    }
  }

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

  MatrixXd M = MatrixXd::Zero(p, p);
  for (const MatrixXd& each : own_product) M += each;
  for (Index i = 0; i < n; ++i) {
    for (Index j = i + 1; j < n; ++j) {
      const VectorXd& ri = own[static_cast<std::size_t>(i)];
      const VectorXd& rj = own[static_cast<std::size_t>(j)];
      const double together = covariances(blocks, i, j, 0)[0] / std::sqrt(std::max(1e-300, ri[0] * rj[0]));
      const double independent =
          count / std::max(1.0, ri.cwiseAbs2().sum() * 2 / std::max(1e-300, ri[0] * ri[0]) - 1);
      if (std::abs(together) < 3 / std::sqrt(std::max(1.0, independent))) continue;
      const double larger = std::sqrt(std::max(1.0, noise[static_cast<std::size_t>(i)][0] / ri[0]) *
                                      std::max(1.0, noise[static_cast<std::size_t>(j)][0] / rj[0]));
      const MatrixXd cross = product(i, j);
      M += larger * (cross + cross.transpose());
    }
  }
  return B * M * B;
}

}  // namespace multipanda
