#include "sysid/identification/inertial_parameters.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <fmt/format.h>

#include "sysid/identification/equations.hpp"
#include "sysid/identification/identify.hpp"

namespace multipanda {
namespace {

Matrix3 inertia_about_origin(const Theta& t) {
  Matrix3 I;
  I << t[4], t[5], t[7], t[5], t[6], t[8], t[7], t[8], t[9];
  return I;
}

Matrix3 point(double mass, const Vector3& c) {
  return mass * (c.squaredNorm() * Matrix3::Identity() - c * c.transpose());
}

// dP/dtheta_k.
const std::array<Eigen::Matrix4d, 10>& directions() {
  static const std::array<Eigen::Matrix4d, 10> all = [] {
    std::array<Eigen::Matrix4d, 10> out;
    for (int k = 0; k < 10; ++k) out[static_cast<std::size_t>(k)] = pseudo_inertia(Theta::Unit(k));
    return out;
  }();
  return all;
}

using Eigen::Index;

constexpr double kZeroColumn = 1e-9;  // of the longest
constexpr double kDependent = 1e-8;   // of the first pivot; dependent columns are at 1e-13

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

Theta theta_of(const RigidBody& body) {
  const Matrix3 I = body.inertia + point(body.mass, body.com);
  Theta t;
  t << body.mass, body.mass * body.com, I(0, 0), I(0, 1), I(1, 1), I(0, 2), I(1, 2), I(2, 2);
  return t;
}

RigidBody body_of(const Theta& theta) {
  const Vector3 com = theta.segment<3>(1) / theta[0];
  return {theta[0], com, inertia_about_origin(theta) - point(theta[0], com)};
}

Eigen::Matrix4d pseudo_inertia(const Theta& theta) {
  const Matrix3 I = inertia_about_origin(theta);
  Eigen::Matrix4d P;
  P.topLeftCorner<3, 3>() = 0.5 * I.trace() * Matrix3::Identity() - I;
  P.topRightCorner<3, 1>() = theta.segment<3>(1);
  P.bottomLeftCorner<1, 3>() = theta.segment<3>(1).transpose();
  P(3, 3) = theta[0];
  return P;
}

RigidBody floored(const RigidBody& body, double floor) {
  const Matrix3 S = 0.5 * body.inertia.trace() * Matrix3::Identity() - body.inertia;
  const Eigen::SelfAdjointEigenSolver<Matrix3> solver(S);
  const Matrix3 lifted = solver.eigenvectors() * solver.eigenvalues().cwiseMax(floor).asDiagonal() *
                         solver.eigenvectors().transpose();
  return {body.mass, body.com, lifted.trace() * Matrix3::Identity() - lifted};
}

Divergence::Divergence(const Theta& prior) {
  const Eigen::Matrix4d P0 = pseudo_inertia(prior);
  inverse_ = P0.inverse();
  log_det_ = std::log(P0.determinant());
  for (int k = 0; k < 10; ++k) trace_[k] = (inverse_ * directions()[static_cast<std::size_t>(k)]).trace();
}

double Divergence::value(const Theta& theta, Theta* gradient, Eigen::Matrix<double, 10, 10>* hessian) const {
  const Eigen::Matrix4d P = pseudo_inertia(theta);
  const Eigen::LLT<Eigen::Matrix4d> llt(P);
  if (llt.info() != Eigen::Success) return std::numeric_limits<double>::infinity();
  const double log_det = 2 * llt.matrixLLT().diagonal().array().log().sum();
  if (!std::isfinite(log_det)) return std::numeric_limits<double>::infinity();
  if (gradient != nullptr) {
    const Eigen::Matrix4d inverse = llt.solve(Eigen::Matrix4d::Identity());
    std::array<Eigen::Matrix4d, 10> M;
    for (std::size_t k = 0; k < 10; ++k) M[k] = inverse * directions()[k];
    for (int a = 0; a < 10; ++a) {
      const Eigen::Matrix4d& Ma = M[static_cast<std::size_t>(a)];
      (*gradient)[a] = trace_[a] - Ma.trace();
      if (hessian == nullptr) continue;
      for (int b = 0; b <= a; ++b) {
        const Eigen::Matrix4d& Mb = M[static_cast<std::size_t>(b)];
        (*hessian)(a, b) = (*hessian)(b, a) = Ma.cwiseProduct(Mb.transpose()).sum();  // tr(Ma Mb)
      }
    }
  }
  return trace_.dot(theta) - (log_det - log_det_) - 4;
}

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
