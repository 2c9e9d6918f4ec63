#include "sysid/identification/commanded_stretches.hpp"

#include <algorithm>
#include <cmath>

namespace multipanda {
namespace {

using Eigen::Index;

double sigmoid(double x) { return 1.0 / (1.0 + std::exp(-x)); }

double table(const JointFriction& f, Index j, double dq) {
  return f.p1[j] * (sigmoid(f.p2[j] * (dq + f.p3[j])) - sigmoid(f.p2[j] * f.p3[j]));
}

CommandedStretch stretch_of(const MeasuredLog& log, const RobotDescription& prior, double period, Index first,
                            Index rows) {
  const Index n = log.joints();
  CommandedStretch s{.period = period,
                     .command = log.tau_cmd.middleRows(first, rows - 1),
                     .beyond = {},
                     .q = {},
                     .ddq = {},
                     .friction = {}};
  s.beyond = log.tau.middleRows(first + 1, rows - 1);
  if (prior.torque_sensor) {
    for (Index j = 0; j < n; ++j) {
      if (prior.torque_sensor->offset.size() == n) s.beyond.col(j).array() -= prior.torque_sensor->offset[j];
      if (prior.torque_sensor->gain.size() == n) s.beyond.col(j) /= prior.torque_sensor->gain[j];
    }
  }
  s.beyond -= log.gravity.middleRows(first, rows - 1);
  s.q = log.q.middleRows(first, rows - 1);
  s.ddq.resize(rows - 1, n);
  for (Index k = 0; k + 1 < rows; ++k) {
    const Index a = std::max(first, first + k - 1), b = std::min(first + rows - 1, first + k + 2);
    s.ddq.row(k) = (log.dq.row(b) - log.dq.row(a)) / (log.t[b] - log.t[a]);
  }
  if (prior.motor_inertia.size() == n) s.beyond += s.ddq * prior.motor_inertia.asDiagonal();
  if (!prior.friction) return s;
  s.friction.resize(rows - 1, n);
  for (Index k = 0; k + 1 < rows; ++k) {
    for (Index j = 0; j < n; ++j) s.friction(k, j) = table(*prior.friction, j, log.dq(first + k + 1, j));
  }
  return s;
}

}  // namespace

double median_of(const Eigen::VectorXd& values) {
  std::vector<double> sorted(values.data(), values.data() + values.size());
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  return *middle;
}

std::vector<CommandedStretch> commanded_stretches(const MeasuredLog& log, const RobotDescription& prior,
                                                  double shortest) {
  const auto n = static_cast<Index>(prior.joint_count());
  if (log.joints() != n) {
    throw LogRefused(log.source + ": " + std::to_string(log.joints()) + " joints, robot '" + prior.name +
                     "' has " + std::to_string(n) + "; name the robot of the log with --robot");
  }
  if (log.tau_cmd.rows() != log.samples()) {
    throw LogRefused(log.source +
                     ": no commanded torque (tau_cmd); delay and bandwidth need a log of "
                     "a multipanda run under torque control");
  }
  if (log.gravity.rows() != log.samples()) {
    throw LogRefused(
        log.source +
        ": no gravity from the arm's own model; the log needs a scene or the columns gravity1..");
  }
  std::vector<CommandedStretch> stretches;
  if (log.samples() < 3) return stretches;
  const double period = median_of(log.t.tail(log.samples() - 1) - log.t.head(log.samples() - 1));
  const auto least = static_cast<Index>(std::ceil(shortest / period));
  Index first = 0;
  for (Index k = 1; k <= log.samples(); ++k) {
    const bool goes_on = k < log.samples() && std::abs(log.t[k] - log.t[k - 1] - period) < 0.2 * period;
    if (goes_on) continue;
    if (k - first >= least) stretches.push_back(stretch_of(log, prior, period, first, k - first));
    first = k;
  }
  return stretches;
}

}  // namespace multipanda
