#include "sysid/excitation/base_condition.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include <Eigen/Eigenvalues>
#include <Eigen/QR>

namespace multipanda {
namespace {

constexpr int kStates = 200;       // far more rows than columns
constexpr double kNothing = 1e-9;  // relative to the largest pivot: smaller columns depend on the others

}  // namespace

BaseCondition::BaseCondition(const RobotDescription& robot) : regressor_(robot) {
  const auto n = static_cast<Eigen::Index>(robot.joint_count());
  std::mt19937_64 bits(1);
  const auto draw = [&] {
    JointVector v(n);
    for (Eigen::Index i = 0; i < n; ++i) v[i] = (static_cast<double>(bits() >> 11) * 0x1p-52 - 1) * 3;
    return v;
  };
  Eigen::MatrixXd stacked(n * kStates, 10 * n);
  for (Eigen::Index s = 0; s < kStates; ++s) {
    const JointVector q = draw(), dq = draw(), ddq = draw();
    stacked.middleRows(n * s, n) = regressor_.evaluate(q, dq, ddq);
  }
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(stacked);
  qr.setThreshold(kNothing);
  for (Eigen::Index k = 0; k < qr.rank(); ++k) columns_.push_back(qr.colsPermutation().indices()[k]);
  std::sort(columns_.begin(), columns_.end());
  chosen_.resize(n, static_cast<Eigen::Index>(columns_.size()));
  begin();
}

void BaseCondition::begin() { gram_ = Eigen::MatrixXd::Zero(chosen_.cols(), chosen_.cols()); }

void BaseCondition::add(const JointVector& q, const JointVector& dq, const JointVector& ddq) {
  const Eigen::MatrixXd& Y = regressor_.evaluate(q, dq, ddq);
  for (std::size_t k = 0; k < columns_.size(); ++k) {
    chosen_.col(static_cast<Eigen::Index>(k)) = Y.col(columns_[k]);
  }
  gram_.selfadjointView<Eigen::Lower>().rankUpdate(chosen_.transpose());
}

double BaseCondition::value() const {
  const Eigen::VectorXd length = gram_.diagonal().cwiseSqrt();
  if (!(length.minCoeff() > 0)) return std::numeric_limits<double>::infinity();
  const Eigen::VectorXd scale = length.cwiseInverse();
  const Eigen::MatrixXd scaled = scale.asDiagonal() * gram_ * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(scaled, Eigen::EigenvaluesOnly);
  const double least = solver.eigenvalues().minCoeff(), most = solver.eigenvalues().maxCoeff();
  return least > 0 ? std::sqrt(most / least) : std::numeric_limits<double>::infinity();
}

}  // namespace multipanda
