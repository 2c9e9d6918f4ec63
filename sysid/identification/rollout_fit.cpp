#include "sysid/identification/rollout_fit.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "scene/build.hpp"
#include "sysid/identification/rollouts.hpp"
#include "sysid/identification/windows.hpp"

namespace multipanda {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kBlocks = 4;      // members that share a candidate's windows
constexpr std::size_t kCandidates = 5;  // at once: a center and two steps of two parameters
constexpr double kLongest = 0.032;      // time constant of 5 Hz [s]

Actuation actuation_at(const VectorXd& x) {
  return {.torque_bandwidth_hz = x[1] > 1e-5 ? 1 / (2 * std::numbers::pi * x[1]) : 0, .command_delay = x[0]};
}

double median_of(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Predicts tau_J, dq and q of every row of every window for candidates of (delay, time constant).
class Replay {
 public:
  Replay(std::span<const MeasuredLog> logs, const Scene& scene, std::size_t arm, const ActuationFit& start,
         std::optional<JointFriction> friction, const RolloutOptions& options)
      : logs_(logs),
        windows_(choose_windows(logs, options.window, options.windows)),
        rollouts_(scene, arm, kBlocks * kCandidates, options.threads),
        friction_(std::move(friction)),
        offset_(start.offset),
        joints_(static_cast<Index>(rollouts_.world().joints)) {
    for (const auto& log : logs_) periods_.push_back(period_of(log));
    deviation_ = MatrixXd::Ones(3, joints_);
  }

  const std::vector<RolloutWindow>& windows() const { return windows_; }
  Index rows_of_window() const { return windows_[0].length * 3 * joints_; }
  std::size_t rollouts() const { return simulated_; }
  const std::string& error() const { return rollouts_.error(); }

  std::vector<VectorXd> operator()(const MatrixXd& candidates) {
    const auto count = static_cast<std::size_t>(candidates.cols());
    std::vector<std::vector<MatrixXd>> tracked(count);
    std::vector<VectorXd> e(count);
    for (std::size_t c = 0; c < count; ++c) {
      e[c].resize(rows_of_window() * static_cast<Index>(windows_.size()));
      for (std::size_t l = 0; l < logs_.size(); ++l) {
        const VectorXd x = candidates.col(static_cast<Index>(c));
        tracked[c].push_back(tracked_torque(logs_[l].tau_cmd, actuation_at(x), periods_[l]));
      }
    }
    const bool whole = rollouts_.run(count * kBlocks, [&](RolloutMember& member, std::size_t i) {
      const std::size_t c = i / kBlocks;
      for (std::size_t w = i % kBlocks; w < windows_.size(); w += kBlocks) {
        replay(member, windows_[w], tracked[c][windows_[w].log],
               e[c].segment(static_cast<Index>(w) * rows_of_window(), rows_of_window()));
      }
    });
    simulated_ += count * windows_.size();
    for (auto& column : e) {
      if (!whole || !column.allFinite()) column.resize(0);
    }
    return e;
  }

  // From now on, residuals of each joint and quantity are weighted by their spread. Those of q and dq drift
  // together within a window, so the spread of their mean over a window counts, as if it were white. Medians
  // are used so that a window in which the log did something else has little effect.
  void weigh(const VectorXd& e) {
    const Index length = windows_[0].length, rows = e.size() / (3 * joints_);
    for (Index kind = 0; kind < 3; ++kind) {
      for (Index j = 0; j < joints_; ++j) {
        std::vector<double> each, sums;
        for (Index k = 0; k < rows; ++k) {
          if (k % length == 0) sums.push_back(0);
          const double value = e[(k * 3 + kind) * joints_ + j];
          each.push_back(std::abs(value));
          sums.back() += value / std::sqrt(static_cast<double>(length));
        }
        for (double& sum : sums) sum = std::abs(sum);
        const double spread = std::max(median_of(each), median_of(sums)) / 0.6745;  // of a normal's magnitude
        deviation_(kind, j) *= std::max(spread, 1e-12);
      }
    }
  }

 private:
  void replay(RolloutMember& member, const RolloutWindow& window, const MatrixXd& tracked,
              Eigen::Ref<VectorXd> e) const {
    const MeasuredLog& log = logs_[window.log];
    rollouts_.begin(member, window.q, window.dq);
    rollouts_.lead_in(member, log.dq, window.first);
    JointVector torque = window.q;
    for (Index k = 0; k < window.length; ++k) {
      const Index row = window.first + k;
      member.terms->update(member.q, member.dq);
      torque = tracked.row(row).transpose() + member.terms->g();
      rollouts_.period(member, torque, friction_ ? &*friction_ : nullptr);
      for (Index j = 0; j < joints_; ++j) {
        const Index at = k * 3 * joints_ + j;
        e[at] = (member.tau[j] + offset_[j] - log.tau(row + 1, j)) / deviation_(0, j);
        e[at + joints_] = (member.dq[j] - log.dq(row + 1, j)) / deviation_(1, j);
        e[at + 2 * joints_] = (member.q[j] - log.q(row + 1, j)) / deviation_(2, j);
      }
    }
  }

  std::span<const MeasuredLog> logs_;
  std::vector<RolloutWindow> windows_;
  Rollouts rollouts_;
  std::optional<JointFriction> friction_;
  JointVector offset_;
  Index joints_;
  std::vector<double> periods_;
  MatrixXd deviation_;  // (3 x n): tau, dq, q
  std::size_t simulated_ = 0;
};

std::optional<JointFriction> scaled_friction(const Scene& scene, std::size_t arm, const ActuationFit& start) {
  std::optional<JointFriction> friction = plant_robot_of(scene.arms.at(arm)).friction;
  if (!friction || start.friction_scale.size() != friction->p1.size()) return std::nullopt;
  friction->p1 = friction->p1.cwiseProduct(start.friction_scale.cwiseMax(0));
  return friction;
}

}  // namespace

ActuationRollouts fit_actuation_by_rollouts(std::span<const MeasuredLog> logs, const Scene& scene,
                                            std::size_t arm, const ActuationFit& start,
                                            const RolloutOptions& options) {
  for (const auto& log : logs) {
    if (log.tau_cmd.rows() == log.samples()) continue;
    throw LogRefused(log.source + ": no commanded torque (tau_cmd) to replay");
  }
  Replay replay(logs, scene, arm, start, scaled_friction(scene, arm, start), options);
  if (replay.windows().size() < 4) {
    throw LogRefused((logs.empty() ? std::string("no log") : logs[0].source) + ": only " +
                     std::to_string(replay.windows().size()) +
                     " windows without a gap to replay, expected at least 4; record a longer run");
  }
  BatchLeastSquares problem;
  const double hz = start.actuation.torque_bandwidth_hz;
  problem.start =
      Eigen::Vector2d(start.actuation.command_delay, hz > 0 ? 1 / (2 * std::numbers::pi * hz) : 0);
  problem.step = Eigen::Vector2d(5e-5, 5e-5);
  problem.lower = Eigen::Vector2d(0, 0);
  problem.upper = Eigen::Vector2d(0.02, kLongest);
  problem.cluster = replay.rows_of_window();
  problem.passes = options.passes;

  ActuationRollouts result;
  result.fit.names = {"delay [ms]", "time constant of torque [ms]"};
  // Twice: weights from a start that is far off reflect its error, not noise and model.
  BatchLeastSquaresResult solved;
  for (int round = 0; round < 2; ++round) {
    const auto first = replay(problem.start);
    if (first[0].size() == 0) {
      throw std::invalid_argument("the log cannot be replayed in this scene: " + replay.error());
    }
    replay.weigh(first[0]);
    const int before = result.fit.passes;
    const auto shown = [&](int pass, double rms, const VectorXd& x) {
      return !options.progress ||
             options.progress({before + pass, rms, result.fit.names, 1e3 * x, replay.rollouts()});
    };
    solved = solve(
        problem, [&](const MatrixXd& c) { return replay(c); }, shown);
    problem.start = solved.x;
    result.fit.passes += solved.passes;
  }
  result.actuation = actuation_at(solved.x);
  result.fit.value = 1e3 * solved.x;
  result.fit.half95 = 1.96e3 * solved.covariance.diagonal().cwiseSqrt();
  result.fit.rms = solved.rms;
  result.fit.converged = solved.converged;
  result.fit.windows = replay.windows().size();
  result.fit.rollouts = replay.rollouts();
  if (!solved.converged) {
    result.fit.warnings.push_back("not converged after " + std::to_string(result.fit.passes) + " passes");
  }
  return result;
}

}  // namespace multipanda
