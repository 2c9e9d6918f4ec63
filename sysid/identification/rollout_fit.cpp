#include "sysid/identification/rollout_fit.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include <Eigen/Dense>

#include "core/types/statistics.hpp"
#include "scene/build.hpp"
#include "sysid/identification/actuation.hpp"
#include "sysid/identification/rollouts.hpp"

namespace multipanda {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kSmallStep = 0.03;  // convergence: steps below this fraction of every standard deviation
// Step lengths that are tried in parallel, relative to the current damping.
constexpr std::array kDamping{0.01, 1.0, 100.0, 1e4};

struct Slopes {
  VectorXd e;  // residual
  MatrixXd J;  // (rows x p)
};

Slopes slopes(const BatchLeastSquares& problem, const BatchResiduals& residuals, const VectorXd& x) {
  const Index p = x.size();
  MatrixXd candidates = x.replicate(1, 1 + 2 * p);
  for (Index i = 0; i < p; ++i) {
    candidates(i, 1 + 2 * i) = std::min(x[i] + problem.step[i], problem.upper[i]);
    candidates(i, 2 + 2 * i) = std::max(x[i] - problem.step[i], problem.lower[i]);
  }
  const std::vector<VectorXd> e = residuals(candidates);
  for (const VectorXd& column : e) {
    if (column.size() == 0)
      throw std::runtime_error("the fit's start cannot be simulated: the state diverges");
  }
  Slopes s{.e = e[0], .J = MatrixXd(e[0].size(), p)};
  for (Index i = 0; i < p; ++i) {
    const auto up = static_cast<std::size_t>(1 + 2 * i), down = up + 1;
    s.J.col(i) = (e[up] - e[down]) / (candidates(i, 1 + 2 * i) - candidates(i, 2 + 2 * i));
  }
  return s;
}

MatrixXd covariance(const Slopes& s, Index cluster) {
  const Index p = s.J.cols();
  MatrixXd S = MatrixXd::Zero(p, p);
  Index count = 0;
  for (Index at = 0; at < s.e.size(); at += cluster, ++count) {
    const Index rows = std::min(cluster, s.e.size() - at);
    const VectorXd score = s.J.middleRows(at, rows).transpose() * s.e.segment(at, rows);
    S += score * score.transpose();
  }
  const MatrixXd inverse = (s.J.transpose() * s.J).ldlt().solve(MatrixXd::Identity(p, p));
  const double n = static_cast<double>(std::max<Index>(count, 2));
  return n / (n - 1) * inverse * S * inverse;
}

constexpr std::size_t kBlocks = 4;      // rollouts that share a candidate's windows
constexpr std::size_t kCandidates = 5;  // in parallel: a center and two steps of two parameters
constexpr double kLongest = 0.032;      // time constant of 5 Hz [s]

Actuation actuation_at(const VectorXd& x) {
  return {.torque_bandwidth_hz = x[1] > 1e-5 ? 1 / (2 * std::numbers::pi * x[1]) : 0, .command_delay = x[0]};
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
    for (const auto& log : logs_) periods_.push_back(log.period());
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
  // limit the effect of windows with a disturbance.
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
        const double spread =
            std::max(quantile(each, 0.5), quantile(sums, 0.5)) / 0.6745;  // of a normal's magnitude
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

BatchLeastSquaresResult solve(const BatchLeastSquares& problem, const BatchResiduals& residuals,
                              const std::function<bool(int, double, const VectorXd&)>& shown) {
  BatchLeastSquaresResult result{.x = problem.start, .covariance = {}};
  double damping = 1e-3;
  const auto rms = [](const VectorXd& e) {
    return std::sqrt(e.squaredNorm() / static_cast<double>(e.size()));
  };
  Slopes here = slopes(problem, residuals, result.x);
  for (result.passes = 1; result.passes <= problem.passes; ++result.passes) {
    const MatrixXd H = here.J.transpose() * here.J;
    const VectorXd g = here.J.transpose() * here.e;
    MatrixXd tries(result.x.size(), 4);
    for (int i = 0; i < 4; ++i) {
      MatrixXd damped = H;
      damped.diagonal() *= 1 + damping * kDamping[static_cast<std::size_t>(i)];
      tries.col(i) = (result.x - damped.ldlt().solve(g)).cwiseMax(problem.lower).cwiseMin(problem.upper);
    }
    const std::vector<VectorXd> e = residuals(tries);
    int best = -1;
    double least = here.e.squaredNorm();
    for (int i = 0; i < 4; ++i) {
      const VectorXd& column = e[static_cast<std::size_t>(i)];
      if (column.size() == 0 || !(column.squaredNorm() < least)) continue;
      least = column.squaredNorm();
      best = i;
    }
    const VectorXd deviation = covariance(here, problem.cluster).diagonal().cwiseSqrt();
    if (best < 0) {
      // Not even a short step reduces the cost: the minimum within the accuracy of the differences.
      damping *= 1e6;
      result.converged = damping > 1e3;
      if ((shown && !shown(result.passes, rms(here.e), result.x)) || result.converged) break;
      continue;
    }
    const VectorXd moved = tries.col(best) - result.x;
    result.x = tries.col(best);
    damping = std::max(1e-9, 0.3 * damping * kDamping[static_cast<std::size_t>(best)]);
    here = slopes(problem, residuals, result.x);
    result.converged = (moved.cwiseAbs().array() <= kSmallStep * deviation.array()).all();
    if ((shown && !shown(result.passes, rms(here.e), result.x)) || result.converged) break;
  }
  result.passes = std::min(result.passes, problem.passes);
  result.rms = rms(here.e);
  result.covariance = covariance(here, problem.cluster);
  return result;
}

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
  // Twice: weights from a poor start reflect its error, not noise and model error.
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
