#include "sysid/identification/predict.hpp"

#include <fmt/format.h>

#include "sysid/identification/arm_regressor.hpp"
#include "sysid/identification/equations.hpp"
#include "sysid/identification/inertial_parameters.hpp"

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

std::string outside_range(const MeasuredLog& log, const RobotDescription& robot) {
  if (!robot.identified_range) return "";
  const IdentifiedRange& range = *robot.identified_range;
  std::string joints;
  for (Eigen::Index j = 0; j < log.joints(); ++j) {
    const double below = range.q_min[j] - log.q.col(j).minCoeff(),
                 above = log.q.col(j).maxCoeff() - range.q_max[j],
                 faster = log.dq.col(j).cwiseAbs().maxCoeff() - range.dq_max[j];
    std::string by;
    if (std::max(below, above) > 0.05) by = fmt::format("{:.2f} rad", std::max(below, above));
    if (faster > 0.1) by += fmt::format("{}{:.2f} rad/s", by.empty() ? "" : ", ", faster);
    if (!by.empty()) joints += fmt::format("{}joint {} by {}", joints.empty() ? "" : "; ", j + 1, by);
  }
  if (joints.empty()) return "";
  return fmt::format("{} leaves the motion from which {} was identified, where its error is not known: {}",
                     log.source, robot.name, joints);
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
