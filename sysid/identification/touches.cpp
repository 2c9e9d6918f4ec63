#include "sysid/identification/touches.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "core/model/model_terms.hpp"
#include "core/state/external_force.hpp"
#include "models/arm_source.hpp"
#include "sysid/identification/arm_regressor.hpp"

namespace multipanda {
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
  X_WB.rotation = Quaternion::FromTwoVectors(gravity_B, Vector3(0, 0, -1)).toRotationMatrix();
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
