#include <cmath>
#include <filesystem>

#include <fmt/format.h>

#include "sysid/identification/equations.hpp"
#include "sysid/identification/identify_parts.hpp"

// The arm is known and a body at its flange is not. All its ten parameters are identifiable from the last
// link's regressor. Friction, gains, offsets and tilt of `robot` are subtracted from the torque first.
namespace multipanda {
namespace {

using Eigen::Index;

constexpr double kLittlePrior = 1e-7;  // small: affects only parameters that the data do not determine, near
                                       // the prior's body

// A typical body on a flange.
RigidBody usual_body() { return {0.5, Vector3(0, 0, 0.05), 0.5 * 2 * 0.05 * 0.05 * Matrix3::Identity()}; }

void take_out_known(FilteredLog& log, const RobotDescription& robot, const Vector3& gravity_B) {
  log.gravity_B = tilted(log.gravity_B.value_or(gravity_B), robot.base_tilt);
  if (robot.torque_sensor) {
    const TorqueSensor& sensor = *robot.torque_sensor;
    for (Index j = 0; j < log.tau.cols(); ++j) {
      if (sensor.offset.size() > 0) log.tau.col(j).array() -= sensor.offset[j];
      if (sensor.gain.size() > 0) log.tau.col(j) /= sensor.gain[j];
    }
  }
  if (robot.link_friction)
    log.tau -= protocol_filter(friction_torque(*robot.link_friction, log.dq, kProtocolStep));
}

}  // namespace

Identification identify_payload(std::span<const MeasuredLog> logs, const RobotDescription& prior,
                                const IdentifyOptions& options) {
  Identification out;
  FilteredLogs filtered = filtered_logs(logs, prior);
  out.seconds_used = filtered.seconds;
  const std::vector<FilteredLog> measured = filtered.logs;
  for (FilteredLog& log : filtered.logs) take_out_known(log, prior, options.gravity_B);
  const auto n = static_cast<Index>(prior.joint_count());

  Candidates set = payload_candidates();
  const EquationSource source{&prior, set.parts, options.gravity_B};
  const std::size_t folds = std::max<std::size_t>(3, options.folds);
  const std::vector<Equations> blocks = equations_of(filtered.logs, source, folds);
  const std::vector<Equations> alone = equations_of(filtered.logs, source, folds, true);
  const Equations all = stacked(blocks, [](std::size_t) { return true; });
  Eigen::VectorXd carried = thetas_of(prior);
  if (const auto body = known_body(prior, options.hand, options.tool)) carried.tail<10>() += theta_of(*body);
  for (const FilteredLog& log : filtered.logs) {
    refuse_unexplained(log.source,
                       equations_of(std::span(&log, 1), {&prior, {}, options.gravity_B}, 1).front(), carried,
                       prior);
  }
  std::vector<Index> last(10);
  for (Index k = 0; k < 10; ++k) last[static_cast<std::size_t>(k)] = 10 * (n - 1) + k;
  refuse_unexciting(condition_of(all, last), out.warnings);

  // The only unknown is the body, in the last link's frame; everything else is `known` or fixed.
  FitProblem problem{.parts = set.parts, .prior = thetas_of(prior), .lambda = kLittlePrior};
  problem.fixed.assign(prior.joint_count(), true);
  problem.fixed.back() = false;
  problem.known = carried.tail<10>();
  const Pose X_LF = prior.flange.pose();
  problem.prior.tail<10>() = theta_of(moved(usual_body(), X_LF));
  const CrossValidation validation = cross_validate(blocks, alone, problem, set, true, options.threads);
  const Family& family = set.families[validation.chosen];
  put_scores(validation, set, prior.joint_count(), true, out);
  put_motion(filtered.logs, out);
  put_held_out(
      logs, source, problem, family, folds,
      [&](FilteredLog& log) { take_out_known(log, prior, options.gravity_B); }, out);
  const RigidBody in_link = body_of(validation.fit.theta.tail<10>());
  out.payload = moved(in_link, X_LF.inverse());
  out.robot = prior;
  out.robot.links.back() = merged(prior.links.back(), in_link);
  for (std::size_t i = 1; i < prior.links.size(); ++i)
    out.prior_consistent.push_back(is_physical(prior.links[i]));
  out.consistent = is_physical(in_link);
  out.dissipative = true;
  out.robot.origin["inertials"] = fmt::format(
      "{}, with a body of {:.4f} kg on the flange, identified from {:.1f} s of measured torque ({}).",
      prior.name, in_link.mass, out.seconds_used,
      std::filesystem::path(logs.front().source).filename().string());

  // Intervals from the linear stage of the same equations.
  LinearOptions linear;
  linear.hand = options.hand;
  if (options.tool) linear.tool = options.tool;
  linear.body_only = true;
  for (const std::size_t p : family.parts) linear.friction.push_back(set.parts[p]);
  std::vector<MotionData> data;
  for (const FilteredLog& log : filtered.logs) {
    data.push_back({log.kept_rows(log.q), log.kept_rows(log.dq), log.kept_rows(log.ddq),
                    log.kept_rows(log.tau), kept_friction(log, linear.friction, prior.friction),
                    log.gravity_B});
  }
  RobotDescription plain = prior;  // gains and tilt are already subtracted
  plain.torque_sensor.reset();
  plain.base_tilt.setZero();
  out.linear = fit_linear(data, plain, linear);
  // com = (mass com) / mass: first order in both.
  const Eigen::Matrix4d C = out.linear.covariance.topLeftCorner<4, 4>();
  double worst = 0;
  for (Index axis = 0; axis < 3; ++axis) {
    Eigen::Vector4d slope = Eigen::Vector4d::Zero();
    slope[0] = -in_link.com[axis] / in_link.mass;
    slope[axis + 1] = 1 / in_link.mass;
    worst = std::max(worst, std::sqrt(std::max(0.0, slope.dot(C * slope))));
  }
  out.payload_mass_half95 = out.linear.half95[0];
  out.payload_com_half95 = 1.96 * worst;
  for (const std::size_t p : family.parts) {
    if (set.parts[p].kind != FrictionKind::offset) continue;
    TorqueSensor sensor = prior.torque_sensor.value_or(TorqueSensor{});
    const JointVector gain = sensor.gain.size() > 0 ? sensor.gain : JointVector::Ones(n);
    const JointVector before = sensor.offset.size() > 0 ? sensor.offset : JointVector::Zero(n);
    sensor.offset =
        before + gain.cwiseProduct(JointVector(validation.fit.friction.col(static_cast<Index>(p))));
    out.robot.torque_sensor = sensor;
  }
  put_predictions(measured, prior, options, out);
  return out;
}

}  // namespace multipanda
