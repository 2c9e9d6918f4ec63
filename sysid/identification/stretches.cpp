#include <algorithm>
#include <cmath>

#include "sysid/identification/actuation.hpp"

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

constexpr Index kHalf = 4;       // of the samples that a start state is smoothed over
constexpr double kSettle = 0.1;  // before a window [s]

// Value at the middle of 2 kHalf + 1 samples, of the parabola through them in the least-squares sense.
JointVector smooth(const Eigen::MatrixXd& series, Index row) {
  // Weights of Savitzky and Golay (1964) for second order, nine points.
  constexpr double kWeights[] = {-21, 14, 39, 54, 59, 54, 39, 14, -21};
  JointVector value = JointVector::Zero(series.cols());
  for (Index i = -kHalf; i <= kHalf; ++i)
    value += kWeights[i + kHalf] / 231.0 * series.row(row + i).transpose();
  return value;
}

}  // namespace

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
  const double period = log.period();
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

std::vector<RolloutWindow> choose_windows(std::span<const MeasuredLog> logs, double seconds, std::size_t most,
                                          const std::vector<std::vector<char>>& usable) {
  std::vector<RolloutWindow> all;
  for (std::size_t l = 0; l < logs.size(); ++l) {
    const MeasuredLog& log = logs[l];
    if (log.samples() < 3) continue;
    const double period = log.period();
    const auto length = std::max<Index>(2, static_cast<Index>(std::lround(seconds / period)));
    const auto before = static_cast<Index>(std::ceil(kSettle / period)) + kHalf;
    Index good_since = 0;  // first row without a gap up to here
    Index next = before;
    for (Index k = 1; k < log.samples(); ++k) {
      if (std::abs(log.t[k] - log.t[k - 1] - period) > 0.2 * period) good_since = k;
      next = std::max(next, good_since + before);
      const Index first = k - length;
      if (first < next) continue;
      const auto is_usable = [&](Index row) {
        return usable.empty() || usable[l][static_cast<std::size_t>(row)] != 0;
      };
      bool whole = true;
      for (Index row = first; row <= k && whole; ++row) whole = is_usable(row);
      if (!whole) continue;
      all.push_back({.log = l,
                     .first = first,
                     .length = length,
                     .q = smooth(log.q, first),
                     .dq = smooth(log.dq, first)});
      next = k;
    }
  }
  if (all.size() <= most) return all;
  std::vector<RolloutWindow> chosen;
  for (std::size_t i = 0; i < most; ++i) chosen.push_back(all[i * all.size() / most]);
  return chosen;
}

}  // namespace multipanda
