#include "sysid/identification/predict.hpp"

#include <fmt/format.h>

#include "sysid/identification/arm_regressor.hpp"
#include "sysid/identification/friction_columns.hpp"
#include "sysid/identification/inertial_parameters.hpp"
#include "sysid/identification/model_torque.hpp"

namespace multipanda {
namespace {

constexpr double kShortestPrediction = 0.6;  // 0.2 s are cut at each end [s]

JointVector root_mean_square(const Eigen::MatrixXd& e) {
  return (e.colwise().squaredNorm().transpose() / static_cast<double>(std::max<Eigen::Index>(1, e.rows())))
      .cwiseSqrt();
}

}  // namespace

Eigen::MatrixXd model_torque(const FilteredLog& log, const RobotDescription& robot,
                             const PredictOptions& options) {
  ArmRegressor regressor(robot);
  const Eigen::Index n = regressor.joints();
  Eigen::VectorXd theta = thetas_of(robot);
  if (const auto body = known_body(robot, options.hand, options.tool)) theta.tail<10>() += theta_of(*body);
  const Vector3 gravity = tilted(log.gravity_B.value_or(options.gravity_B), robot.base_tilt);
  Eigen::MatrixXd out(static_cast<Eigen::Index>(log.kept.size()), n);
  for (Eigen::Index i = 0; i < out.rows(); ++i) {
    const Eigen::Index at = log.kept[static_cast<std::size_t>(i)];
    out.row(i) = regressor.at(log.q.row(at), log.dq.row(at), log.ddq.row(at), gravity) * theta;
  }
  Eigen::MatrixXd friction = Eigen::MatrixXd::Zero(log.t.size(), n);
  if (robot.link_friction) friction += friction_torque(*robot.link_friction, log.dq, kProtocolStep);
  if (options.motor_friction && robot.friction) friction += friction_torque(*robot.friction, log.dq);
  if (!friction.isZero(0)) out += log.kept_rows(protocol_filter(friction));
  if (robot.torque_sensor && robot.torque_sensor->gain.size() == n) {
    out *= Eigen::VectorXd(robot.torque_sensor->gain).asDiagonal();
  }
  if (robot.torque_sensor && robot.torque_sensor->offset.size() == n) {
    out.rowwise() += Eigen::RowVectorXd(robot.torque_sensor->offset.transpose());
  }
  return out;
}

Prediction predict(const MeasuredLog& log, const RobotDescription& robot, const PredictOptions& options) {
  if (log.joints() != static_cast<Eigen::Index>(robot.joint_count())) {
    throw LogRefused(fmt::format("{}: {} joints, but {} has {}", log.source, log.joints(), robot.name,
                                 robot.joint_count()));
  }
  const FilteredLog filtered = filter_log(log, kShortestPrediction);
  Prediction out;
  out.predicted = model_torque(filtered, robot, options);
  out.measured = filtered.kept_rows(filtered.tau);
  out.t = filtered.t(filtered.kept);
  out.rmse = root_mean_square(out.predicted - out.measured);
  out.rmse_mean = out.rmse.mean();
  out.rmse_unfiltered = root_mean_square(out.predicted - filtered.kept_rows(filtered.tau_raw));
  return out;
}

}  // namespace multipanda
