#include "commission/rigid_fit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include <Eigen/SVD>

namespace multipanda::commission {

RigidFit fit_rigid(std::span<const Vector3> points_A, std::span<const Vector3> points_B) {
  const std::size_t n = points_A.size();
  if (n != points_B.size() || n < 3) {
    throw std::invalid_argument("a rigid fit needs the same points in both lists, three at least; found " +
                                std::to_string(n) + " and " + std::to_string(points_B.size()));
  }
  Vector3 center_A = Vector3::Zero(), center_B = Vector3::Zero();
  for (std::size_t k = 0; k < n; ++k) {
    if (!points_A[k].allFinite() || !points_B[k].allFinite())
      throw std::invalid_argument("point " + std::to_string(k + 1) + " of a rigid fit is not finite");
    center_A += points_A[k] / static_cast<double>(n);
    center_B += points_B[k] / static_cast<double>(n);
  }
  Matrix3 cross = Matrix3::Zero(), spread = Matrix3::Zero();
  for (std::size_t k = 0; k < n; ++k) {
    const Vector3 a = points_A[k] - center_A, b = points_B[k] - center_B;
    cross += a * b.transpose();
    spread += b * b.transpose() / static_cast<double>(n);
  }
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(cross, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Matrix3 U = svd.matrixU(), V = svd.matrixV();
  const double turn = (U * V.transpose()).determinant() < 0 ? -1 : 1;
  RigidFit fit;
  fit.X_AB.rotation = U * Vector3(1, 1, turn).asDiagonal() * V.transpose();
  fit.X_AB.position = center_A - fit.X_AB.rotation * center_B;
  double sum = 0;
  for (std::size_t k = 0; k < n; ++k) {
    fit.residual_m.push_back((points_A[k] - fit.X_AB * points_B[k]).norm());
    sum += fit.residual_m.back() * fit.residual_m.back();
  }
  fit.rms_m = std::sqrt(sum / static_cast<double>(n));
  Vector3 variances = Eigen::JacobiSVD<Eigen::MatrixXd>(spread).singularValues();
  std::sort(variances.begin(), variances.end());
  fit.width_m = std::sqrt(std::max(0.0, variances[0] + variances[1]));
  // Six of the 3n measured numbers are used up by the transform; n points hold the rotation about the line.
  const double freedom = 3.0 * static_cast<double>(n) - 6;
  const double sigma = std::sqrt(sum / freedom);
  fit.angle_rad = fit.width_m > 1e-9 ? sigma / (fit.width_m * std::sqrt(static_cast<double>(n)))
                                     : std::numeric_limits<double>::infinity();
  return fit;
}

Vector3 rpy_of(const Matrix3& R) {
  const double pitch = std::asin(std::clamp(-R(2, 0), -1.0, 1.0));
  if (std::abs(R(2, 0)) > 1 - 1e-12) return {0, pitch, std::atan2(-R(0, 1), R(1, 1))};
  return {std::atan2(R(2, 1), R(2, 2)), pitch, std::atan2(R(1, 0), R(0, 0))};
}

}  // namespace multipanda::commission
