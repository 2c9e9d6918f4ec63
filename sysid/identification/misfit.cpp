#include "sysid/identification/misfit.hpp"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

namespace multipanda {
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

}  // namespace multipanda
