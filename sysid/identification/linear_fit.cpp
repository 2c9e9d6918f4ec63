#include "sysid/identification/linear_fit.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <fmt/format.h>

#include "sysid/identification/arm_regressor.hpp"
#include "sysid/identification/equations.hpp"
#include "sysid/identification/filtered_log.hpp"
#include "sysid/identification/inertial_parameters.hpp"
#include "sysid/identification/residual_correlation.hpp"

namespace multipanda {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

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
  // What bounds accuracy is the columns' scale: their lengths are taken out before anything is solved.
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
    // Columns shrink by their length; refined once, so that exact data give exact answers.
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
