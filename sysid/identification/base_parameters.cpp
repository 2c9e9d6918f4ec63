#include "sysid/identification/base_parameters.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include <Eigen/QR>
#include <Eigen/SVD>
#include <fmt/format.h>

#include "sysid/identification/arm_regressor.hpp"
#include "sysid/identification/inertial_parameters.hpp"
#include "sysid/identification/mounting.hpp"

namespace multipanda {
namespace {

using Eigen::Index;

constexpr double kZeroColumn = 1e-9;  // of the longest
constexpr double kDependent = 1e-8;   // of the first pivot; what depends is at 1e-13

Eigen::MatrixXd at_random_states(const RobotDescription& robot, const std::vector<Vector3>& gravities_B) {
  ArmRegressor regressor(robot);
  const Index n = regressor.joints();
  const Index states = 40 * n * static_cast<Index>(gravities_B.size());
  std::mt19937_64 random(20240607);
  const auto uniform = [&](double most) {
    return std::uniform_real_distribution<double>(-most, most)(random);
  };
  Eigen::MatrixXd Y(states * n, 10 * n);
  Eigen::VectorXd q(n), dq(n), ddq(n);
  for (Index s = 0; s < states; ++s) {
    for (Index j = 0; j < n; ++j) {
      q[j] = uniform(3.0);
      dq[j] = uniform(2.0);
      ddq[j] = uniform(8.0);
    }
    Y.middleRows(s * n, n) =
        regressor.at(q, dq, ddq, gravities_B[static_cast<std::size_t>(s) % gravities_B.size()]);
  }
  return Y;
}

std::string combination_name(const Eigen::RowVectorXd& row, Index leading) {
  std::string out = theta_name(leading);
  for (Index k = 0; k < row.size(); ++k) {
    if (k == leading || row[k] == 0) continue;
    const double size = std::abs(row[k]);
    out += row[k] < 0 ? " - " : " + ";
    if (std::abs(size - 1) > 1e-9) out += fmt::format("{:.4g} ", size);
    out += theta_name(k);
  }
  return out;
}

}  // namespace

std::string theta_name(Index column) {
  return fmt::format("link{} {}", column / 10 + 1, kThetaNames.at(static_cast<std::size_t>(column % 10)));
}

std::string theta_unit(Index column) {
  const Index k = column % 10;
  return k == 0 ? "kg" : k < 4 ? "kg m" : "kg m^2";
}

BaseParameters base_parameters(const RobotDescription& robot, std::span<const Vector3> gravities_B) {
  std::vector<Vector3> different;
  for (const Vector3& gravity : gravities_B) {
    const bool known = std::any_of(different.begin(), different.end(),
                                   [&](const Vector3& other) { return same_gravity(gravity, other); });
    if (!known) different.push_back(gravity);
  }
  if (different.empty()) different.emplace_back(0, 0, -9.81);
  Eigen::MatrixXd Y = at_random_states(robot, different);
  const Index all = Y.cols();
  const Eigen::VectorXd length = Y.colwise().norm();
  BaseParameters out;
  std::vector<Index> effective;
  for (Index k = 0; k < all; ++k) {
    if (length[k] > kZeroColumn * length.maxCoeff()) {
      effective.push_back(k);
    } else {
      out.unidentifiable.push_back(theta_name(k));
      out.unidentifiable_entries.push_back(k);
    }
  }
  const Eigen::MatrixXd scaled = Y(Eigen::all, effective) * length(effective).cwiseInverse().asDiagonal();
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(scaled);
  const Eigen::MatrixXd R = qr.matrixR();
  Index rank = 0;
  while (rank < scaled.cols() && std::abs(R(rank, rank)) > kDependent * std::abs(R(0, 0))) ++rank;
  const Index rest = scaled.cols() - rank;
  const Eigen::MatrixXd K = R.topLeftCorner(rank, rank)
                                .triangularView<Eigen::Upper>()
                                .solve(R.topRightCorner(rank, scaled.cols()).rightCols(rest));
  const auto& order = qr.colsPermutation().indices();
  const auto column = [&](Index pivot) { return effective[static_cast<std::size_t>(order[pivot])]; };

  out.combination.setZero(rank, all);
  std::vector<bool> shared(static_cast<std::size_t>(all), false);
  for (Index r = 0; r < rank; ++r) {
    const Index lead = column(r);
    out.leading.push_back(lead);
    out.combination(r, lead) = 1;
    for (Index c = 0; c < rest; ++c) {
      if (std::abs(K(r, c)) < 1e-9) continue;
      const Index with = column(rank + c);
      out.combination(r, with) = K(r, c) * length[with] / length[lead];
      shared[static_cast<std::size_t>(lead)] = shared[static_cast<std::size_t>(with)] = true;
    }
    out.names.push_back(combination_name(out.combination.row(r), lead));
  }
  for (const Index k : effective) {
    (shared[static_cast<std::size_t>(k)] ? out.combined : out.alone).push_back(theta_name(k));
  }
  return out;
}

Condition condition_of(const Eigen::MatrixXd& regressor) {
  const auto ratio = [](const Eigen::MatrixXd& A) {
    // A is small; BDCSVD, for large matrices, takes a third of a minute to compile.
    const Eigen::VectorXd s =
        Eigen::JacobiSVD<Eigen::MatrixXd, Eigen::NoQRPreconditioner>(A).singularValues();
    const double least = s[s.size() - 1];
    return least > 0 ? s[0] / least : std::numeric_limits<double>::infinity();
  };
  const Eigen::VectorXd length = regressor.colwise().norm();
  if (regressor.rows() < regressor.cols() || length.minCoeff() <= 0) {
    return {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  }
  // The triangle of a QR has the same singular values, and is small.
  const Eigen::MatrixXd R = Eigen::HouseholderQR<Eigen::MatrixXd>(regressor)
                                .matrixQR()
                                .topRows(regressor.cols())
                                .triangularView<Eigen::Upper>();
  return {ratio(R), ratio(R * length.cwiseInverse().asDiagonal())};
}

}  // namespace multipanda
