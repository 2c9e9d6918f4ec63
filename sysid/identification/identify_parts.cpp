#include "sysid/identification/identify_parts.hpp"

#include <cmath>

#include <Eigen/QR>
#include <fmt/format.h>

#include "sysid/measured/measured_log.hpp"

namespace multipanda {
namespace {

using Eigen::Index;

constexpr double kUnexplained = 0.7;  // of the torque's root mean square
constexpr double kOutside = 0.2;      // beyond the range [rad]
// Scaled condition numbers, measured: 15 to 60 for exciting motions, thousands for a motion of one joint or
// of all joints by the same sine.
constexpr double kHardly = 150, kNot = 1000;

}  // namespace

void refuse_other_robot(std::span<const MeasuredLog> logs, const RobotDescription& robot) {
  for (const MeasuredLog& log : logs) {
    const auto n = static_cast<Index>(robot.joint_count());
    if (log.joints() != n) {
      throw LogRefused(fmt::format("{}: {} joints, but {} has {}; name the robot of the log with --robot",
                                   log.source, log.joints(), robot.name, n));
    }
    for (Index j = 0; j < n; ++j) {
      const double low = log.q.col(j).minCoeff(), high = log.q.col(j).maxCoeff();
      if (low < robot.limits.q_min[j] - kOutside || high > robot.limits.q_max[j] + kOutside) {
        throw LogRefused(fmt::format(
            "{}: joint{} moves from {:.3f} to {:.3f} rad, {} only from {:.3f} to {:.3f}; check that it is "
            "the right robot",
            log.source, j + 1, low, high, robot.name, robot.limits.q_min[j], robot.limits.q_max[j]));
      }
    }
  }
}

void refuse_unexplained(const std::string& source, const Equations& equations, const Eigen::VectorXd& theta,
                        const RobotDescription& robot) {
  const auto n = static_cast<Index>(equations.size());
  double left = 0, measured = 0, worst = 0;
  Index worst_joint = 0;
  for (Index j = 0; j < n; ++j) {
    const JointEquations& joint = equations[static_cast<std::size_t>(j)];
    const Eigen::VectorXd tau = joint.R.rightCols<1>();
    const Eigen::VectorXd e = joint.R.leftCols(10 * (n - j)) * theta.tail(10 * (n - j)) - tau;
    left += e.squaredNorm();
    measured += tau.squaredNorm();
    if (e.squaredNorm() <= worst) continue;
    worst = e.squaredNorm();
    worst_joint = j;
  }
  const double ratio = std::sqrt(left / std::max(1e-12, measured));
  if (ratio <= kUnexplained) return;
  const double rows = static_cast<double>(equations.front().rows);
  throw LogRefused(fmt::format(
      "{}: the model {} leaves {:.0f} % of the measured torque unexplained (most at joint{}: {:.2f} N m), "
      "expected at most {:.0f} %; check the robot, the base (--base), the hand and tool, the order of the "
      "joints, and that torques are in N m with gravity",
      source, robot.name, 100 * ratio, worst_joint + 1, std::sqrt(worst / rows), 100 * kUnexplained));
}

Condition condition_of(const Equations& equations, const std::vector<Index>& leading) {
  const auto n = static_cast<Index>(equations.size());
  Index rows = 0;
  for (const JointEquations& joint : equations) rows += joint.R.rows();
  Eigen::MatrixXd Y = Eigen::MatrixXd::Zero(rows, 10 * n);
  rows = 0;
  for (Index j = 0; j < n; ++j) {
    const Eigen::MatrixXd& R = equations[static_cast<std::size_t>(j)].R;
    Y.block(rows, 10 * j, R.rows(), 10 * (n - j)) = R.leftCols(10 * (n - j));
    rows += R.rows();
  }
  return condition_of(Eigen::MatrixXd(Y(Eigen::all, leading)));
}

void refuse_unexciting(const Condition& condition, std::vector<std::string>& warnings) {
  if (!(condition.scaled <= kNot)) {
    throw LogRefused(
        fmt::format("the motion does not excite all parameters: condition number {:.3g} of the base "
                    "parameters' columns scaled to unit length, expected at most {:g}, ideally about 20; "
                    "record a motion of 'multipanda excite'",
                    condition.scaled, kNot));
  }
  if (condition.scaled > kHardly) {
    warnings.push_back(
        fmt::format("the motion excites some parameters poorly: condition number {:.3g}, about 20 is good; "
                    "unidentifiable parameters stay at the prior",
                    condition.scaled));
  }
}

}  // namespace multipanda
