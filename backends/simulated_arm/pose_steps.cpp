#include "backends/simulated_arm/pose_steps.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/LU>

namespace multipanda {

Vector6 pose_difference(const Pose& X, const Pose& X_before) {
  const Matrix3 R = X.rotation * X_before.rotation.transpose();
  const Vector3 s = 0.5 * Vector3(R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1));
  const double sine = s.norm(), cosine = 0.5 * (R.trace() - 1);
  Vector6 dX;
  dX.head<3>() = X.position - X_before.position;
  if (cosine < 0) {
    dX.tail<3>() = log_rotation(R);
  } else {
    dX.tail<3>() = sine < 1e-9 ? s : Vector3((std::atan2(sine, cosine) / sine) * s);
  }
  return dX;
}

Pose displaced(const Pose& X, const Vector6& dX) {
  return {exp_rotation(dX.tail<3>()) * X.rotation, X.position + dX.head<3>()};
}

Matrix3 nearest_rotation(Matrix3 R) {
  for (int k = 0; k < 2; ++k) R = 0.5 * R * (3 * Matrix3::Identity() - R.transpose() * R);
  return R;
}

double error_of_frame(const Eigen::Matrix4d& T) {
  const Matrix3 R = T.topLeftCorner<3, 3>();
  const bool last_row = T(3, 0) == 0 && T(3, 1) == 0 && T(3, 2) == 0 && T(3, 3) == 1;
  if (!last_row || !(R.determinant() > 0)) return 1;
  const Matrix3 off = R.transpose() * R - Matrix3::Identity();
  // A product of two columns that are off by x each is off by 2 x.
  return std::max({(R.colwise().norm().array() - 1).abs().maxCoeff(),
                   (R.rowwise().norm().array() - 1).abs().maxCoeff(), off.cwiseAbs().maxCoeff() / 2.1});
}

}  // namespace multipanda
