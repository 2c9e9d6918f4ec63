#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/QR>
#include <fmt/format.h>

#include "sysid/identification/equations.hpp"
#include "sysid/identification/filtered_log.hpp"
#include "sysid/identification/identify.hpp"
#include "sysid/identification/inertial_parameters.hpp"

namespace multipanda {
namespace {

// Covariance of least squares for stationary residuals that are correlated in time and across joints:
//   cov = B M B,  M = sum_ij sum_l r_ij(l) sum_t a_i(t)^T a_j(t + l),  B = (sum_j A_j^T A_j)^-1
// r_ij: the residuals' covariances at lag l, with a flat-top window whose width follows from the
// data (Politis, J. Nonparametric Statistics 2003), corrected for the part that the fit absorbed at
// its columns' frequencies.
struct ResidualBlock {
  std::vector<Eigen::MatrixXd> rows;  // A_j, weighted, one per joint (N x p)
  Eigen::MatrixXd residual;           // weighted (N x n)
};

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index kMostLags = 200;
constexpr int kCorrections = 8;  // iterations of the correction for absorbed noise

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

// Blocks are unbroken stretches (logs). `longest_lag` is set to the window's half width [samples].
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

  // Least squares absorbs the part of the noise that the columns can imitate, at their frequencies. At these
  // frequencies up to a third of the noise is missing in the residuals e = (I - H) noise, H = A B A^T. So
  // this solves for covariances r_j of the noise whose
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

constexpr double kNormal95 = 1.959964;
constexpr double kShortestFiltered = 1.0;  // of a log [s]

// Rows of one stretch, one matrix per joint: base columns, then the joint's own friction columns.
struct Stretch {
  std::vector<MatrixXd> A;  // (N x p)
  MatrixXd y;               // (N x n)
};

Stretch rows_of(const MotionData& data, const RobotDescription& robot, const LinearOptions& options,
                const BaseParameters& base, ArmRegressor& regressor) {
  const Index n = regressor.joints(), N = data.q.rows(), r = base.rank();
  const auto k = static_cast<Index>(options.friction.size());
  const VectorXd theta = thetas_of(robot);
  const auto body = known_body(robot, options.hand, options.tool);
  VectorXd known = VectorXd::Zero(theta.size());
  if (body) known.tail<10>() = theta_of(*body);
  if (options.body_only) known += theta;
  const Vector3 gravity = data.gravity_B.value_or(options.gravity_B);
  const Vector3 true_gravity = tilted(gravity, robot.base_tilt);
  const bool level = robot.base_tilt.isZero(0);
  Stretch out;
  out.A.assign(static_cast<std::size_t>(n), MatrixXd::Zero(N, r + n * k));
  out.y = data.tau;
  if (robot.torque_sensor && robot.torque_sensor->gain.size() == n) {
    for (Index j = 0; j < n; ++j) out.y.col(j) /= robot.torque_sensor->gain[j];
  }
  for (Index t = 0; t < N; ++t) {
    const VectorXd q = data.q.row(t), dq = data.dq.row(t), ddq = data.ddq.row(t);
    const MatrixXd& Y = regressor.at(q, dq, ddq, gravity);
    for (Index j = 0; j < n; ++j) {
      out.A[static_cast<std::size_t>(j)].row(t).head(r) = Y.row(j)(base.leading);
    }
    out.y.row(t) -= Y * known;
    if (level) continue;
    out.y.row(t) -=
        regressor.of_field(q, true_gravity - gravity) * (options.body_only ? known : theta + known);
  }
  for (Index j = 0; j < n; ++j) {
    for (Index p = 0; p < k; ++p) {
      out.A[static_cast<std::size_t>(j)].col(r + j * k + p) =
          data.friction[static_cast<std::size_t>(p)].col(j);
    }
  }
  return out;
}

// A body on the last link: its ten parameters, each by itself.
BaseParameters last_body(Index n) {
  BaseParameters out;
  out.combination = MatrixXd::Zero(10, 10 * n);
  out.combination.rightCols<10>().setIdentity();
  for (Index k = 0; k < 10; ++k) {
    out.leading.push_back(10 * (n - 1) + k);
    out.names.push_back(std::string("body ") + kThetaNames[static_cast<std::size_t>(k)]);
  }
  out.alone = out.names;
  return out;
}

}  // namespace

LinearFit fit_linear(std::span<const MotionData> data, const RobotDescription& robot,
                     const LinearOptions& options) {
  ArmRegressor regressor(robot);
  const Index n = regressor.joints();
  LinearFit out;
  std::vector<Vector3> gravities;
  for (const MotionData& motion : data) gravities.push_back(motion.gravity_B.value_or(options.gravity_B));
  out.base = options.body_only ? last_body(n) : base_parameters(robot, gravities);
  const Index r = out.base.rank(), k = static_cast<Index>(options.friction.size()), p = r + n * k;
  std::vector<Stretch> stretches;
  for (const MotionData& motion : data) {
    if (motion.q.cols() != n || motion.friction.size() != options.friction.size()) {
      throw std::invalid_argument("linear fit: data of another arm, or friction columns that do not fit");
    }
    stretches.push_back(rows_of(motion, robot, options, out.base, regressor));
  }
  out.names = out.base.names;
  for (const Index leading : out.base.leading) out.units.push_back(theta_unit(leading));
  for (Index j = 0; j < n; ++j) {
    for (const FrictionPart& part : options.friction) {
      out.names.push_back(fmt::format("joint{} {}", j + 1, to_string(part)));
      out.units.push_back(unit_of(part));
    }
  }
  // Accuracy is limited by the scale of the columns, so they are normalized before solving.
  VectorXd length = VectorXd::Zero(p);
  double count = 0;
  for (const Stretch& s : stretches) {
    for (const MatrixXd& A : s.A) length += A.colwise().squaredNorm().transpose();
    count += static_cast<double>(s.y.rows());
  }
  length = length.cwiseSqrt().cwiseMax(1e-300);
  {
    MatrixXd triangle(0, r);
    for (const Stretch& s : stretches) {
      for (const MatrixXd& A : s.A) {
        MatrixXd both(triangle.rows() + A.rows(), r);
        both << triangle, A.leftCols(r);
        if (both.rows() > r) {
          triangle =
              Eigen::HouseholderQR<MatrixXd>(both).matrixQR().topRows(r).triangularView<Eigen::Upper>();
        } else {
          triangle = std::move(both);
        }
      }
    }
    out.condition = condition_of(triangle);
  }

  VectorXd weight = VectorXd::Ones(n), scaled = VectorXd::Zero(p);
  MatrixXd normal;
  for (int pass = 0; pass < std::max(1, options.passes); ++pass) {
    // Columns shrink by their length; refined once, so that exact data give exact results.
    normal.setZero(p, p);
    for (const Stretch& s : stretches) {
      for (Index j = 0; j < n; ++j) {
        const MatrixXd A = weight[j] * s.A[static_cast<std::size_t>(j)] * length.cwiseInverse().asDiagonal();
        normal.selfadjointView<Eigen::Lower>().rankUpdate(A.transpose());
      }
    }
    normal = normal.selfadjointView<Eigen::Lower>();
    const Eigen::LDLT<MatrixXd> solver(normal);
    scaled.setZero();
    for (int refinement = 0; refinement < 3; ++refinement) {
      VectorXd right = VectorXd::Zero(p);
      for (const Stretch& s : stretches) {
        for (Index j = 0; j < n; ++j) {
          const MatrixXd& A = s.A[static_cast<std::size_t>(j)];
          const VectorXd e = s.y.col(j) - A * scaled.cwiseQuotient(length);
          right += weight[j] * weight[j] * (A.transpose() * e).cwiseQuotient(length);
        }
      }
      scaled += solver.solve(right);
    }
    VectorXd squares = VectorXd::Zero(n);
    for (const Stretch& s : stretches) {
      for (Index j = 0; j < n; ++j) {
        squares[j] +=
            (s.y.col(j) - s.A[static_cast<std::size_t>(j)] * scaled.cwiseQuotient(length)).squaredNorm();
      }
    }
    out.rmse = (squares / count).cwiseSqrt();
    if (pass + 1 < options.passes) weight = out.rmse.cwiseMax(1e-6).cwiseInverse();
  }
  out.value = scaled.cwiseQuotient(length);

  std::vector<ResidualBlock> blocks;
  for (const Stretch& s : stretches) {
    ResidualBlock block;
    block.residual.resize(s.y.rows(), n);
    for (Index j = 0; j < n; ++j) {
      const MatrixXd& A = s.A[static_cast<std::size_t>(j)];
      block.residual.col(j) = weight[j] * (s.y.col(j) - A * out.value);
      block.rows.push_back(weight[j] * A * length.cwiseInverse().asDiagonal());
    }
    blocks.push_back(std::move(block));
  }
  const MatrixXd B = normal.ldlt().solve(MatrixXd::Identity(p, p));
  const MatrixXd covariance = correlated_covariance(blocks, B, &out.longest_lag);
  out.covariance = length.cwiseInverse().asDiagonal() * covariance * length.cwiseInverse().asDiagonal();
  out.half95 = kNormal95 * out.covariance.diagonal().cwiseMax(0).cwiseSqrt();
  return out;
}

LinearFit fit_linear(std::span<const MeasuredLog> logs, const RobotDescription& robot,
                     const LinearOptions& options) {
  std::vector<MotionData> data;
  for (const MeasuredLog& log : logs) {
    const FilteredLog filtered = filter_log(log, kShortestFiltered);
    data.push_back({filtered.kept_rows(filtered.q), filtered.kept_rows(filtered.dq),
                    filtered.kept_rows(filtered.ddq), filtered.kept_rows(filtered.tau),
                    kept_friction(filtered, options.friction, robot.friction), filtered.gravity_B});
  }
  return fit_linear(data, robot, options);
}

}  // namespace multipanda
