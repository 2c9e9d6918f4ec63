#include "sysid/identification/predict.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include <fmt/format.h>

#include "core/model/model_terms.hpp"
#include "core/state/external_force.hpp"
#include "core/types/rotation_between.hpp"
#include "models/arm_source.hpp"
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
  const auto& sensor = robot.torque_sensor;
  const Eigen::VectorXd gain =
      sensor && sensor->gain.size() == n ? Eigen::VectorXd(sensor->gain) : Eigen::VectorXd::Ones(n);
  const Eigen::VectorXd offset =
      sensor && sensor->offset.size() == n ? Eigen::VectorXd(sensor->offset) : Eigen::VectorXd::Zero(n);
  Eigen::MatrixXd friction = Eigen::MatrixXd::Zero(log.t.size(), n);
  if (robot.link_friction) {
    const auto& elements = robot.link_friction->presliding;
    friction += friction_torque(*robot.link_friction, log.dq, kProtocolStep);
    // The friction in which a resting joint began, from the torque before the first row that counts.
    Eigen::VectorXd shown = Eigen::VectorXd::Zero(n), most = Eigen::VectorXd::Zero(n);
    for (const PreslidingElement& e : elements) most += e.amplitude;
    const Eigen::Index before = elements.empty() || log.kept.empty() ? 0 : log.kept.front();
    for (Eigen::Index i = 0; i < before; ++i) {
      const Eigen::VectorXd rigid =
          regressor.at(log.q.row(i), log.dq.row(i), log.ddq.row(i), gravity) * theta;
      shown += ((log.tau.row(i).transpose() - offset).cwiseQuotient(gain) - rigid) / before;
    }
    const Eigen::VectorXd start = shown.cwiseQuotient(most.cwiseMax(1e-9)).cwiseMax(-1).cwiseMin(1);
    for (const PreslidingElement& e : elements) {
      friction += friction_column({FrictionKind::initial, e.distance}, log.dq, log.ddq, {}, kProtocolStep) *
                  start.cwiseProduct(e.amplitude).asDiagonal();
    }
  }
  if (options.motor_friction && robot.friction) friction += friction_torque(*robot.friction, log.dq);
  if (!friction.isZero(0)) out += log.kept_rows(protocol_filter(friction));
  return (out * gain.asDiagonal()).rowwise() + offset.transpose();
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

namespace {

bool fits(const JointVector& rmse) { return rmse.mean() <= kMisfitMean && rmse.maxCoeff() <= kMisfitJoint; }

// The smallest error with a shifted torque, and that shift [s]; positive: the torque is late.
std::pair<JointVector, double> shifted(const Prediction& p) {
  constexpr Eigen::Index kMost = 30, kLeast = 30;  // rows
  const double step =
      p.t.size() > 1 ? (p.t[p.t.size() - 1] - p.t[0]) / static_cast<double>(p.t.size() - 1) : 0;
  std::pair<JointVector, double> best{p.rmse, 0};
  for (Eigen::Index s = -kMost; s <= kMost; ++s) {
    const Eigen::Index rows = p.t.size() - std::abs(s);
    if (rows < kLeast) continue;
    const Eigen::MatrixXd e = p.measured.middleRows(std::max<Eigen::Index>(s, 0), rows) -
                              p.predicted.middleRows(std::max<Eigen::Index>(-s, 0), rows);
    const JointVector rmse = (e.colwise().squaredNorm().transpose() / static_cast<double>(rows)).cwiseSqrt();
    if (rmse.mean() < best.first.mean()) best = {rmse, static_cast<double>(s) * step};
  }
  return best;
}

}  // namespace

std::string misfit(const MeasuredLog& log, const RobotDescription& robot, const PredictOptions& options) {
  const Prediction as_it_is = predict(log, robot, options);
  if (fits(as_it_is.rmse)) return "";
  JointVector least = as_it_is.rmse;
  std::string best;
  const auto consider = [&](const JointVector& rmse, const std::string& what) {
    if (!(rmse.mean() < least.mean())) return;
    least = rmse;
    best = what;
  };
  const auto [late, by] = shifted(as_it_is);
  consider(late, fmt::format("torques that are {:.0f} ms {}", 1e3 * std::abs(by), by > 0 ? "late" : "early"));
  if (robot.hand) {
    PredictOptions other = options;
    other.hand = !options.hand;
    consider(predict(log, robot, other).rmse, other.hand ? "the hand, which --hand declares" : "no hand");
  }
  std::string robots;
  JointVector by_robot;
  for (const std::string& name : available_robots()) {
    const RobotDescription other = load_robot(name);
    if (name == robot.name || other.joint_count() != robot.joint_count() || (options.hand && !other.hand))
      continue;
    const JointVector rmse = predict(log, other, options).rmse;
    if (!fits(rmse)) continue;
    robots += (robots.empty() ? "robot '" : "' or '") + name;  // several may fit equally well
    if (by_robot.size() == 0 || rmse.mean() < by_robot.mean()) by_robot = rmse;
  }
  if (!robots.empty()) consider(by_robot, robots + "'");
  for (Eigen::Index a = 0; a < log.joints(); ++a) {
    for (Eigen::Index b = a + 1; b < log.joints(); ++b) {
      MeasuredLog exchanged = log;
      for (Eigen::MatrixXd* columns : {&exchanged.q, &exchanged.dq, &exchanged.tau})
        columns->col(a).swap(columns->col(b));
      consider(predict(exchanged, robot, options).rmse,
               fmt::format("joints {} and {} exchanged", a + 1, b + 1));
    }
  }
  Eigen::Index worst = 0;
  const double most = as_it_is.rmse.maxCoeff(&worst);
  return fmt::format(
      "{}: {} leaves {:.2f} N m of the torques unexplained (mean of the joints; joint {}: {:.2f}), expected "
      "at most {} and {}: {}",
      log.source, robot.name, as_it_is.rmse_mean, worst + 1, most, kMisfitMean, kMisfitJoint,
      !best.empty() && fits(least) ? fmt::format("{} would leave {:.2f} N m", best, least.mean())
                                   : "check robot, hand, tool, mounting, the order of the joints, and "
                                     "whether something touched the arm");
}

namespace {

using Eigen::Index;

Eigen::MatrixXd low_passed(const Eigen::VectorXd& t, Eigen::MatrixXd values, double hz) {
  for (Index k = 1; k < values.rows(); ++k) {
    const double share = 1 - std::exp(-2 * std::numbers::pi * hz * (t[k] - t[k - 1]));
    values.row(k) = values.row(k - 1) + share * (values.row(k) - values.row(k - 1));
  }
  return values;
}

}  // namespace

Eigen::MatrixXd observed_torque(const MeasuredLog& log, const RobotDescription& robot,
                                const PredictOptions& options) {
  if (log.joints() != static_cast<Index>(robot.joint_count())) {
    throw LogRefused(fmt::format("{}: {} joints, but {} has {}", log.source, log.joints(), robot.name,
                                 robot.joint_count()));
  }
  const Vector3 gravity_B = tilted(log.gravity_B.value_or(options.gravity_B), robot.base_tilt);
  Pose X_WB;
  X_WB.rotation = rotation_between(gravity_B, Vector3(0, 0, -1)).toRotationMatrix();
  ModelTerms terms(std::make_shared<const ArmModel>(arm_model_source(robot, X_WB, options.hand)));
  ArmState state;
  if (options.tool) state.tool = {options.tool->mass, options.tool->com, options.tool->inertia};
  terms.set_config(state.frames, state.tool, state.load);
  ExternalForceObserver observer(robot.joint_count());
  Eigen::MatrixXd out(log.samples(), log.joints());
  for (Index k = 0; k < log.samples(); ++k) {
    state.tau_J = log.tau.row(k);
    state.t_robot = RobotTime::from_seconds(log.t[k] - log.t[0]);
    terms.update(JointVector(log.q.row(k)), JointVector(log.dq.row(k)));
    observer.update({terms.momentum(), terms.momentum_drift(), terms.J_V_WK()}, state);
    out.row(k) = state.tau_ext_hat;
  }
  return out;
}

Touches find_touches(const MeasuredLog& log, const Eigen::MatrixXd& tau_ext, const TouchOptions& options) {
  constexpr double kApart = 0.2, kBefore = 0.05, kAfter = 0.3, kSettled = 0.5;  // [s]
  const Eigen::MatrixXd slow = options.stage_hz > 0 ? low_passed(log.t, tau_ext, options.stage_hz) : tau_ext;
  const Eigen::VectorXd signal =
      (slow - low_passed(log.t, slow, options.tare_hz)).cwiseAbs().rowwise().maxCoeff();
  Touches out;
  double last = -INFINITY;  // above the threshold
  for (Index k = 0; k < log.samples(); ++k) {
    if (signal[k] <= options.threshold) continue;
    if (log.t[k] - last > kApart) out.starts.push_back(log.t[k]);
    last = log.t[k];
  }
  if (log.contact.rows() == 0) return out;
  JudgedTouches& judged = out.judged.emplace();
  std::vector<std::pair<double, double>> labels;  // start and end [s]
  for (Index k = 1; k < log.samples(); ++k) {
    const double before = log.contact(k - 1, 0), now = log.contact(k, 0);
    if (now > before) labels.emplace_back(log.t[k], log.t[log.samples() - 1]);
    if (now < before && !labels.empty()) labels.back().second = log.t[k];
  }
  const auto labeled = [&](double t) {
    return std::ranges::any_of(
        labels, [t](const auto& label) { return t >= label.first - kBefore && t <= label.second + kAfter; });
  };
  judged.touches = labels.size();
  for (const auto& [start, end] : labels) {
    Index k = std::lower_bound(log.t.begin(), log.t.end(), start - kBefore) - log.t.begin();
    while (k < log.samples() && log.t[k] <= end && signal[k] <= options.threshold) ++k;
    if (k < log.samples() && log.t[k] <= end) {
      judged.delays.push_back(log.t[k] - start);
    } else {
      ++judged.missed;
    }
  }
  for (Index k = 0; k < log.samples(); ++k) {
    if (log.t[k] - log.t[0] > kSettled && !labeled(log.t[k]))
      judged.quiet = std::max(judged.quiet, signal[k]);
  }
  judged.false_alarms = static_cast<std::size_t>(
      std::ranges::count_if(out.starts, [&](double t) { return t - log.t[0] > kSettled && !labeled(t); }));
  return out;
}

}  // namespace multipanda
