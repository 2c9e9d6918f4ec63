#include "sysid/identification/batch_least_squares.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include <Eigen/Dense>

namespace multipanda {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kSmallStep = 0.03;  // convergence: steps below this fraction of every standard deviation
// Step lengths that are tried at once, relative to the current damping.
constexpr std::array kDamping{0.01, 1.0, 100.0, 1e4};

struct Slopes {
  VectorXd e;  // residual
  MatrixXd J;  // (rows x p)
};

Slopes slopes(const BatchLeastSquares& problem, const BatchResiduals& residuals, const VectorXd& x) {
  const Index p = x.size();
  MatrixXd candidates = x.replicate(1, 1 + 2 * p);
  for (Index i = 0; i < p; ++i) {
    candidates(i, 1 + 2 * i) = std::min(x[i] + problem.step[i], problem.upper[i]);
    candidates(i, 2 + 2 * i) = std::max(x[i] - problem.step[i], problem.lower[i]);
  }
  const std::vector<VectorXd> e = residuals(candidates);
  for (const VectorXd& column : e) {
    if (column.size() == 0)
      throw std::runtime_error("the fit's start cannot be simulated: the state diverges");
  }
  Slopes s{.e = e[0], .J = MatrixXd(e[0].size(), p)};
  for (Index i = 0; i < p; ++i) {
    const auto up = static_cast<std::size_t>(1 + 2 * i), down = up + 1;
    s.J.col(i) = (e[up] - e[down]) / (candidates(i, 1 + 2 * i) - candidates(i, 2 + 2 * i));
  }
  return s;
}

MatrixXd covariance(const Slopes& s, Index cluster) {
  const Index p = s.J.cols();
  MatrixXd S = MatrixXd::Zero(p, p);
  Index count = 0;
  for (Index at = 0; at < s.e.size(); at += cluster, ++count) {
    const Index rows = std::min(cluster, s.e.size() - at);
    const VectorXd score = s.J.middleRows(at, rows).transpose() * s.e.segment(at, rows);
    S += score * score.transpose();
  }
  const MatrixXd inverse = (s.J.transpose() * s.J).ldlt().solve(MatrixXd::Identity(p, p));
  const double n = static_cast<double>(std::max<Index>(count, 2));
  return n / (n - 1) * inverse * S * inverse;
}

}  // namespace

BatchLeastSquaresResult solve(const BatchLeastSquares& problem, const BatchResiduals& residuals,
                              const std::function<bool(int, double, const VectorXd&)>& shown) {
  BatchLeastSquaresResult result{.x = problem.start, .covariance = {}};
  double damping = 1e-3;
  const auto rms = [](const VectorXd& e) {
    return std::sqrt(e.squaredNorm() / static_cast<double>(e.size()));
  };
  Slopes here = slopes(problem, residuals, result.x);
  for (result.passes = 1; result.passes <= problem.passes; ++result.passes) {
    const MatrixXd H = here.J.transpose() * here.J;
    const VectorXd g = here.J.transpose() * here.e;
    MatrixXd tries(result.x.size(), 4);
    for (int i = 0; i < 4; ++i) {
      MatrixXd damped = H;
      damped.diagonal() *= 1 + damping * kDamping[static_cast<std::size_t>(i)];
      tries.col(i) = (result.x - damped.ldlt().solve(g)).cwiseMax(problem.lower).cwiseMin(problem.upper);
    }
    const std::vector<VectorXd> e = residuals(tries);
    int best = -1;
    double least = here.e.squaredNorm();
    for (int i = 0; i < 4; ++i) {
      const VectorXd& column = e[static_cast<std::size_t>(i)];
      if (column.size() == 0 || !(column.squaredNorm() < least)) continue;
      least = column.squaredNorm();
      best = i;
    }
    const VectorXd deviation = covariance(here, problem.cluster).diagonal().cwiseSqrt();
    if (best < 0) {
      // No step reduces the cost, not even a short one: this is the minimum within the accuracy
      // of the differences.
      damping *= 1e6;
      result.converged = damping > 1e3;
      if ((shown && !shown(result.passes, rms(here.e), result.x)) || result.converged) break;
      continue;
    }
    const VectorXd moved = tries.col(best) - result.x;
    result.x = tries.col(best);
    damping = std::max(1e-9, 0.3 * damping * kDamping[static_cast<std::size_t>(best)]);
    here = slopes(problem, residuals, result.x);
    result.converged = (moved.cwiseAbs().array() <= kSmallStep * deviation.array()).all();
    if ((shown && !shown(result.passes, rms(here.e), result.x)) || result.converged) break;
  }
  result.passes = std::min(result.passes, problem.passes);
  result.rms = rms(here.e);
  result.covariance = covariance(here, problem.cluster);
  return result;
}

}  // namespace multipanda
