#include "commission/fits.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <stdexcept>
#include <string>

#include <Eigen/QR>
#include <Eigen/SVD>
#include <fmt/format.h>

#include "core/model/model_terms.hpp"
#include "core/types/rotation_between.hpp"
#include "scene/build.hpp"

namespace multipanda::commission {
namespace {

constexpr double kGravity = 9.81;

ModelTerms terms_of(SceneArm arm, const Matrix3& R_WB) {
  arm.X_WB.rotation = R_WB;
  ModelTerms terms(build_arm_model(arm));
  const ArmConfig config = arm_config(arm);
  terms.set_config(ArmFrames{}, config.tool, config.load);  // E at the flange, where the fitted body is
  return terms;
}

// Orientation of a base in whose axes gravity has this direction.
Matrix3 base_with_gravity_along(const Vector3& direction_B) {
  return rotation_between(direction_B, -Vector3::UnitZ()).toRotationMatrix();
}

double rms(const Eigen::VectorXd& v) { return v.norm() / std::sqrt(static_cast<double>(v.size())); }

}  // namespace

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
  // The transform uses up six of the 3n measured numbers; n points determine the rotation about the line.
  const double freedom = 3.0 * static_cast<double>(n) - 6;
  const double sigma = std::sqrt(sum / freedom);
  fit.angle_rad = fit.width_m > 1e-9 ? sigma / (fit.width_m * std::sqrt(static_cast<double>(n)))
                                     : std::numeric_limits<double>::infinity();
  return fit;
}

GravityFit fit_gravity(const SceneArm& arm, std::span<const RestSample> samples) {
  if (samples.empty()) throw std::invalid_argument("a fit of gravity needs a sample at rest");
  ModelTerms expected = terms_of(arm, arm.X_WB.rotation);
  std::array<std::unique_ptr<ModelTerms>, 3> along;
  for (int axis = 0; axis < 3; ++axis) {
    along[static_cast<std::size_t>(axis)] =
        std::make_unique<ModelTerms>(terms_of(arm, base_with_gravity_along(Vector3::Unit(axis))));
  }
  const auto n = static_cast<Eigen::Index>(expected.joint_count());
  const auto rows = n * static_cast<Eigen::Index>(samples.size());
  Eigen::VectorXd measured(rows), difference(rows);
  Eigen::MatrixXd by_gravity(rows, 3), by_load(rows, 4);
  const JointVector still = JointVector::Zero(n);
  const Vector3 gravity_W(0, 0, -kGravity);
  for (std::size_t k = 0; k < samples.size(); ++k) {
    const RestSample& sample = samples[k];
    if (sample.q.size() != n || sample.tau_J.size() != n)
      throw std::invalid_argument("a sample at rest has another number of joints than arm '" + arm.name +
                                  "'");
    const Eigen::Index row = n * static_cast<Eigen::Index>(k);
    expected.update(sample.q, still);
    measured.segment(row, n) = sample.tau_J;
    difference.segment(row, n) = sample.tau_J - expected.g();
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      ModelTerms& terms = *along[static_cast<std::size_t>(axis)];
      terms.update(sample.q, still);
      by_gravity.block(row, axis, n, 1) = terms.g() / kGravity;
    }
    // A body of mass m at c in the flange: weight m g, moment (R m c) x g about the flange, both held
    // by the joints.
    const auto& J = expected.J_V_WE();
    const Matrix3 R_WF = expected.X_WF().rotation;
    by_load.block(row, 0, n, 1) = -J.topRows<3>().transpose() * gravity_W;
    by_load.block(row, 1, n, 3) = J.bottomRows<3>().transpose() * skew(gravity_W) * R_WF;
  }
  GravityFit fit;
  Eigen::Index worst = 0;
  fit.largest_nm = difference.cwiseAbs().maxCoeff(&worst);
  fit.joint = static_cast<int>(worst % n);
  fit.rms_nm = rms(difference);
  fit.gravity_B = by_gravity.completeOrthogonalDecomposition().solve(measured);
  fit.tilt_rms_nm = rms(measured - by_gravity * fit.gravity_B);
  const Vector3 scene_B = arm.X_WB.rotation.transpose() * gravity_W;
  fit.tilt_rad = std::atan2(fit.gravity_B.cross(scene_B).norm(), fit.gravity_B.dot(scene_B));
  // Minimum-norm solution: in one pose the center's component along gravity causes no torque.
  Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> solver;
  solver.setThreshold(1e-6);
  solver.compute(by_load);
  const Eigen::Vector4d body = solver.solve(difference);
  fit.mass_kg = body[0];
  fit.moment_kg_m = body.tail<3>();
  fit.load_rms_nm = rms(difference - by_load * body);
  return fit;
}

std::string GravityFit::text() const {
  const double degrees = 180 / std::numbers::pi * tilt_rad;
  if (load_explains()) {
    return fmt::format(
        "explained by {:.2f} kg {} on the flange than the scene declares (remaining: {:.2f} N m)",
        std::abs(mass_kg), mass_kg > 0 ? "more" : "less", load_rms_nm);
  }
  return fmt::format("explained by a base turned by {:.1f} degrees from the scene's (remaining: {:.2f} N m)",
                     degrees, tilt_rms_nm);
}

}  // namespace multipanda::commission
