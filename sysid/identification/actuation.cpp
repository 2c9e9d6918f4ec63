#include "sysid/identification/actuation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>
#include <tuple>

#include <Eigen/Dense>

#include "core/types/statistics.hpp"

namespace multipanda {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kBlock = 0.1;            // residuals farther apart count as independent [s]
constexpr double kOutlier = 6.0;          // standard deviations
constexpr double kShortestStretch = 0.2;  // shortest usable stretch [s]

std::string number(double value, const char* format = "%.4g") {
  char text[32];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

// Solves for everything except delay and bandwidth in closed form: per joint the friction scale
// and the offset.
class Problem {
 public:
  Problem(std::vector<CommandedStretch> stretches, const ActuationOptions& options, Index joints)
      : stretches_(std::move(stretches)), joints_(joints), has_friction_(stretches_[0].friction.cols() > 0) {
    for (const CommandedStretch& s : stretches_) {
      const Index settle = settled(s, options);
      begins_.push_back(settle);
      rows_ += s.command.rows() - settle;
    }
    weight_ = MatrixXd::Ones(rows_, joints_);
    friction_.resize(rows_, has_friction_ ? joints_ : 0);
    q_.resize(rows_, joints_);
    ddq_.resize(rows_, joints_);
    Index at = 0;
    each([&](const CommandedStretch& s, Index begin, Index rows) {
      if (has_friction_) friction_.middleRows(at, rows) = s.friction.bottomRows(rows);
      q_.middleRows(at, rows) = s.q.bottomRows(rows);
      ddq_.middleRows(at, rows) = s.ddq.bottomRows(rows);
      (void)begin;
      at += rows;
    });
  }

  Index rows() const { return rows_; }
  bool has_friction() const { return has_friction_; }
  double period() const { return stretches_[0].period; }
  const MatrixXd& friction() const { return friction_; }
  const MatrixXd& q() const { return q_; }
  const MatrixXd& ddq() const { return ddq_; }

  // beyond - tracked (rows x n), before friction and offset are subtracted.
  MatrixXd raw(const Actuation& actuation) const {
    MatrixXd e(rows_, joints_);
    Index at = 0;
    each([&](const CommandedStretch& s, Index begin, Index rows) {
      const MatrixXd x = tracked_torque(s.command, actuation, s.period);
      e.middleRows(at, rows) = s.beyond.bottomRows(rows) - x.bottomRows(rows);
      (void)begin;
      at += rows;
    });
    return e;
  }

  struct Linear {
    VectorXd scale, offset;  // (n x 1)
    MatrixXd residual;       // (rows x n)
    double cost = 0;
  };
  Linear solve(const Actuation& actuation) const {
    Linear l{.scale = VectorXd::Zero(joints_), .offset = VectorXd::Zero(joints_), .residual = raw(actuation)};
    for (Index j = 0; j < joints_; ++j) {
      const auto w = weight_.col(j).array();
      const auto y = l.residual.col(j).array();
      const double sum = w.sum(), mean = (w * y).sum() / sum;
      if (has_friction_) {
        const auto f = friction_.col(j).array();
        const double f_mean = (w * f).sum() / sum;
        const double spread = (w * (f - f_mean).square()).sum();
        if (spread > 1e-9 * sum) l.scale[j] = -(w * (f - f_mean) * (y - mean)).sum() / spread;
        l.offset[j] = mean + l.scale[j] * f_mean;
        l.residual.col(j) += l.scale[j] * friction_.col(j);
      } else {
        l.offset[j] = mean;
      }
      l.residual.col(j).array() -= l.offset[j];
      l.cost += (w * l.residual.col(j).array().square()).sum();
    }
    return l;
  }

  // Removes rows far from this model (an arm that held itself, a reflex) and returns how many. Medians are
  // used because such rows bias the offsets.
  Index leave_out(const MatrixXd& residual) {
    MatrixXd centered = residual;
    const auto count = static_cast<std::size_t>(rows_);
    for (Index j = 0; j < joints_; ++j) centered.col(j).array() -= median({residual.col(j).data(), count});
    const VectorXd size = centered.rowwise().norm();
    const double limit = kOutlier * std::max(median({size.data(), count}), 1e-6);
    Index out = 0;
    for (Index k = 0; k < rows_; ++k) {
      const bool keep = size[k] <= limit;
      weight_.row(k).setConstant(keep ? 1 : 0);
      out += keep ? 0 : 1;
    }
    return out;
  }
  const MatrixXd& weight() const { return weight_; }

 private:
  static Index settled(const CommandedStretch& s, const ActuationOptions& options) {
    return std::min<Index>(
        s.command.rows() - 1,
        static_cast<Index>(std::ceil((options.settle + options.longest_delay) / s.period)));
  }
  template <typename Work>
  void each(Work work) const {
    for (std::size_t i = 0; i < stretches_.size(); ++i) {
      work(stretches_[i], begins_[i], stretches_[i].command.rows() - begins_[i]);
    }
  }
  std::vector<CommandedStretch> stretches_;
  std::vector<Index> begins_;
  Index joints_ = 0, rows_ = 0;
  bool has_friction_ = false;
  MatrixXd friction_, q_, ddq_, weight_;
};

// Mean over the 11 rows around each one: noise of the measured velocity would reduce the explained part
// of ddq.
MatrixXd smoothed(const MatrixXd& x) {
  constexpr Index kHalf = 5;
  MatrixXd sums = MatrixXd::Zero(x.rows() + 1, x.cols()), mean(x.rows(), x.cols());
  for (Index k = 0; k < x.rows(); ++k) sums.row(k + 1) = sums.row(k) + x.row(k);
  for (Index k = 0; k < x.rows(); ++k) {
    const Index from = std::max<Index>(k - kHalf, 0), to = std::min(k + kHalf + 1, x.rows());
    mean.row(k) = (sums.row(to) - sums.row(from)) / static_cast<double>(to - from);
  }
  return mean;
}

// What the motors add to the inertia of joint j, by -I_m ddq in its residual: least squares beside friction
// and offset. Judged by blocked cross-validation: 0 unless each of kParts contiguous parts of the data,
// predicted from the others, is at least kGain better with it than without.
double added_inertia(const Problem& problem, const VectorXd& residual, Index j) {
  constexpr Index kParts = 6;
  constexpr double kGain = 0.01;
  const Index rows = problem.rows();
  MatrixXd columns(rows, problem.has_friction() ? 4 : 3);
  columns.col(0) = -problem.ddq().col(j);
  columns.col(1).setOnes();
  // An error of the gravity model depends on q, which for a single sine is proportional to -ddq: the part
  // that both explain is attributed to neither.
  columns.col(2) = problem.q().col(j).array() - problem.q().col(j).mean();
  if (problem.has_friction()) columns.col(3) = -problem.friction().col(j);
  columns = smoothed(columns);
  const VectorXd raw = smoothed(residual);
  const VectorXd w = problem.weight().col(j);
  const auto solved = [&](const MatrixXd& X, const VectorXd& weight) -> VectorXd {
    MatrixXd H = X.transpose() * weight.asDiagonal() * X;
    H.diagonal().array() += 1e-9 * H.diagonal().maxCoeff();
    return H.ldlt().solve(X.transpose() * weight.cwiseProduct(raw));
  };
  const auto without = columns.rightCols(columns.cols() - 1);
  for (Index part = 0; part < kParts; ++part) {
    const Index from = part * rows / kParts, count = (part + 1) * rows / kParts - from;
    VectorXd others = w;
    others.segment(from, count).setZero();
    const auto left_out = [&](const MatrixXd& X) {
      const VectorXd e = raw - X * solved(X, others);
      return std::sqrt(e.segment(from, count).cwiseAbs2().dot(w.segment(from, count)));
    };
    if (!(left_out(columns) < (1 - kGain) * left_out(without))) return 0;
  }
  return solved(columns, w)[0];
}

// Delay, and the time constant 1 / (2 pi bandwidth). Unlike the bandwidth, it enters almost linearly.
Eigen::Vector2d coordinates(const Actuation& a) {
  return {a.command_delay,
          a.torque_bandwidth_hz > 0 ? 1 / (2 * std::numbers::pi * a.torque_bandwidth_hz) : 0};
}
Actuation actuation_at(const Eigen::Vector2d& x) {
  return {.torque_bandwidth_hz = x[1] > 0 ? 1 / (2 * std::numbers::pi * x[1]) : 0, .command_delay = x[0]};
}

Actuation best_on_grid(const Problem& problem, const ActuationOptions& options) {
  Actuation best;
  double least = std::numeric_limits<double>::infinity();
  std::vector<double> bandwidths{0};
  for (double hz = options.lowest_bandwidth; hz < options.highest_bandwidth; hz *= 1.35)
    bandwidths.push_back(hz);
  for (double delay = 0; delay <= options.longest_delay + 1e-9; delay += 0.0005) {
    for (const double hz : bandwidths) {
      const Actuation here{.torque_bandwidth_hz = hz, .command_delay = delay};
      const double cost = problem.solve(here).cost;
      if (cost < least) std::tie(least, best) = std::tuple(cost, here);
    }
  }
  return best;
}

constexpr double kStep = 2e-5;  // step of the differences in both coordinates [s]

// d residual / d coordinate.
template <typename Residual>
std::array<MatrixXd, 2> slopes(const Residual& residual_at, const Eigen::Vector2d& x) {
  std::array<MatrixXd, 2> J;
  for (int i = 0; i < 2; ++i) {
    Eigen::Vector2d up = x, down = x;
    up[i] += kStep;
    down[i] = std::max(x[i] - kStep, 0.0);
    J[static_cast<std::size_t>(i)] =
        (residual_at(actuation_at(up)) - residual_at(actuation_at(down))) / (up[i] - down[i]);
  }
  return J;
}

double weighted_dot(const MatrixXd& a, const MatrixXd& b, const MatrixXd& w) {
  return (a.array() * b.array() * w.array()).sum();
}

Actuation refine(const Problem& problem, const Actuation& start, const ActuationOptions& options) {
  Eigen::Vector2d x = coordinates(start);
  const double longest = 1 / (2 * std::numbers::pi * options.lowest_bandwidth);
  double cost = problem.solve(actuation_at(x)).cost, damping = 1e-6;
  for (int pass = 0; pass < 40; ++pass) {
    const MatrixXd e = problem.solve(actuation_at(x)).residual;
    // Friction and offset refitted at both ends: variable projection, Kaufman's form.
    const auto J = slopes([&](const Actuation& at) { return problem.solve(at).residual; }, x);
    Eigen::Matrix2d H;
    Eigen::Vector2d g;
    for (int i = 0; i < 2; ++i) {
      g[i] = weighted_dot(J[static_cast<std::size_t>(i)], e, problem.weight());
      for (int k = 0; k < 2; ++k) {
        H(i, k) =
            weighted_dot(J[static_cast<std::size_t>(i)], J[static_cast<std::size_t>(k)], problem.weight());
      }
    }
    bool better = false;
    double moved = 0;
    for (int attempt = 0; attempt < 12 && !better; ++attempt) {
      Eigen::Matrix2d damped = H;
      damped.diagonal() *= 1 + damping;
      Eigen::Vector2d to = x - damped.ldlt().solve(g);
      to[0] = std::clamp(to[0], 0.0, options.longest_delay);
      to[1] = std::clamp(to[1], 0.0, longest);
      const double there = problem.solve(actuation_at(to)).cost;
      better = there < cost;
      if (better) {
        moved = (to - x).norm();
        x = to;
        cost = there;
      }
      damping = std::clamp(damping * (better ? 0.2 : 10), 1e-9, 1e9);
    }
    if (!better || moved < 1e-8) break;
  }
  return actuation_at(x);
}

// Covariance of delay, time constant, scales and offsets for correlated residuals: H^-1 S H^-1, with S from
// sums of the score over blocks of kBlock (White 1980; blocks as clusters).
MatrixXd covariance(const Problem& problem, const Eigen::Vector2d& x, const MatrixXd& e, Index joints) {
  const Index rows = e.rows(), per = problem.has_friction() ? 2 : 1, count = 2 + per * joints;
  const auto J = slopes([&](const Actuation& at) { return problem.raw(at); }, x);
  const auto block = std::max<Index>(1, static_cast<Index>(std::lround(kBlock / problem.period())));
  MatrixXd H = MatrixXd::Zero(count, count), S = H;
  VectorXd score = VectorXd::Zero(count), row(count);
  for (Index k = 0; k < rows; ++k) {
    for (Index j = 0; j < joints; ++j) {
      if (problem.weight()(k, j) == 0) continue;
      row.setZero();
      row[0] = J[0](k, j);
      row[1] = J[1](k, j);
      row[2 + per * j] = -1;
      if (per == 2) row[3 + per * j] = problem.friction()(k, j);
      H.noalias() += row * row.transpose();
      score += row * e(k, j);
    }
    if ((k + 1) % block == 0 || k + 1 == rows) {
      S.noalias() += score * score.transpose();
      score.setZero();
    }
  }
  const VectorXd scale = H.diagonal().cwiseMax(1e-30).cwiseSqrt().cwiseInverse();
  MatrixXd scaled = scale.asDiagonal() * H * scale.asDiagonal();
  scaled.diagonal().array() += 1e-12;
  const MatrixXd inverse =
      scale.asDiagonal() * scaled.ldlt().solve(MatrixXd::Identity(count, count)) * scale.asDiagonal();
  const double blocks = std::max(2.0, std::ceil(static_cast<double>(rows) / static_cast<double>(block)));
  return blocks / (blocks - 1) * inverse * S * inverse;
}

void fill(ActuationFit& fit, const Problem& problem, Index n) {
  const auto best = problem.solve(fit.actuation);
  const Eigen::Vector2d x = coordinates(fit.actuation);
  const MatrixXd C = covariance(problem, x, best.residual, n);
  constexpr double k95 = 1.96;
  fit.delay_half95 = k95 * std::sqrt(C(0, 0));
  if (x[1] > 0) fit.bandwidth_half95 = k95 * std::sqrt(C(1, 1)) * fit.actuation.torque_bandwidth_hz / x[1];
  fit.offset = best.offset;
  if (problem.has_friction()) {
    fit.friction_scale = best.scale;
    fit.friction_scale_half95 = JointVector::Zero(n);
    for (Index j = 0; j < n; ++j) {
      fit.friction_scale_half95[j] = k95 * std::sqrt(C(3 + 2 * j, 3 + 2 * j));
    }
  }
  fit.rms = JointVector::Zero(n);
  double white = 0, pairs = 0;
  for (Index j = 0; j < n; ++j) {
    const auto w = problem.weight().col(j).array();
    fit.rms[j] = std::sqrt((w * best.residual.col(j).array().square()).sum() / w.sum());
    for (Index k = 0; k + 1 < problem.rows(); ++k) {
      if (w[k] == 0 || w[k + 1] == 0) continue;
      const double step = best.residual(k + 1, j) - best.residual(k, j);
      white += 0.5 * step * step;  // differences remove a slow misfit
      pairs += 1;
    }
  }
  fit.noise = std::sqrt(white / std::max(pairs, 1.0));
}

void warn(ActuationFit& fit, Index out, Index rows) {
  if (static_cast<double>(out) > 0.02 * static_cast<double>(rows)) {
    fit.warnings.push_back(number(100.0 * static_cast<double>(out) / static_cast<double>(rows)) +
                           " % of the rows do not follow the commands and were left out");
  }
  if (fit.delay_half95 > 0.0005) {
    fit.warnings.push_back("the delay is known only to +-" + number(1e3 * fit.delay_half95) +
                           " ms; command torques that change faster");
  }
  if (fit.bandwidth_half95 > 0.2 * fit.actuation.torque_bandwidth_hz) {
    fit.warnings.push_back("the bandwidth is known only to +-" + number(fit.bandwidth_half95) +
                           " Hz; command torques that change faster");
  }
}

}  // namespace

MatrixXd tracked_torque(const MatrixXd& tau_cmd, const Actuation& actuation, double period) {
  const double periods = std::max(actuation.command_delay, 0.0) / period;
  const auto whole = static_cast<Index>(std::floor(periods));
  const double part = periods - std::floor(periods);
  const double gain = actuation.torque_bandwidth_hz > 0
                          ? -std::expm1(-2 * std::numbers::pi * actuation.torque_bandwidth_hz * period)
                          : 1.0;
  MatrixXd tracked(tau_cmd.rows(), tau_cmd.cols());
  for (Index j = 0; j < tau_cmd.cols(); ++j) {
    double x = tau_cmd.rows() > 0 ? tau_cmd(0, j) : 0;
    for (Index k = 0; k < tau_cmd.rows(); ++k) {
      const double newer = tau_cmd(std::max<Index>(k - whole, 0), j);
      const double older = tau_cmd(std::max<Index>(k - whole - 1, 0), j);
      x += gain * ((1 - part) * newer + part * older - x);
      tracked(k, j) = x;
    }
  }
  return tracked;
}

namespace {

// The fit with the prior's motor inertia; `found`: what motors add beyond it.
ActuationFit fit_once(std::span<const MeasuredLog> logs, const RobotDescription& prior,
                      const ActuationOptions& options, JointVector& found) {
  std::vector<CommandedStretch> stretches;
  for (const auto& log : logs) {
    for (auto& stretch : commanded_stretches(log, prior, kShortestStretch + options.settle))
      stretches.push_back(std::move(stretch));
  }
  if (stretches.empty()) {
    throw LogRefused((logs.empty() ? std::string("no log") : logs[0].source) + ": no stretch of " +
                     number(kShortestStretch + options.settle) + " s without a gap: record a longer run");
  }
  const auto n = static_cast<Index>(prior.joint_count());
  Problem problem(std::move(stretches), options, n);
  ActuationFit fit;
  fit.actuation = best_on_grid(problem, options);
  (void)problem.leave_out(problem.solve(fit.actuation).residual);
  const Index out = problem.leave_out(problem.solve(fit.actuation).residual);
  fit.actuation = refine(problem, fit.actuation, options);
  if (fit.actuation.torque_bandwidth_hz > options.highest_bandwidth) fit.actuation.torque_bandwidth_hz = 0;
  fill(fit, problem, n);
  fit.samples = static_cast<std::size_t>(problem.rows() - out);
  if (fit.samples < static_cast<std::size_t>(problem.rows() / 2)) {
    throw LogRefused(logs[0].source + ": the measured torque follows the commands in only " +
                     number(100.0 * static_cast<double>(fit.samples) / static_cast<double>(problem.rows())) +
                     " % of the rows; was the arm under torque control?");
  }
  warn(fit, out, problem.rows());
  const MatrixXd raw = problem.raw(fit.actuation);
  found = JointVector::Zero(n);
  for (Index j = 0; j < n; ++j) found[j] = added_inertia(problem, raw.col(j), j);
  if (prior.motor_inertia.size() == 0) found = found.cwiseMax(0).eval();
  return fit;
}

}  // namespace

ActuationFit fit_actuation(std::span<const MeasuredLog> logs, const RobotDescription& prior,
                           const ActuationOptions& options) {
  JointVector found, more;
  const ActuationFit fit = fit_once(logs, prior, options, found);
  if (prior.motor_inertia.size() > 0 || found.isZero(0)) return fit;
  // Again with the motor inertia, which delays the torque as a lower bandwidth does, until that masks none.
  constexpr int kMostPasses = 6;
  RobotDescription with = prior;
  ActuationFit better;
  more = JointVector::Zero(found.size());
  for (int pass = 0; pass < kMostPasses; ++pass) {
    found = (found + more).cwiseMax(0);
    with.motor_inertia = found;
    better = fit_once(logs, with, options, more);
    if (more.isZero(0)) break;
  }
  better.motor_inertia = found;
  return better;
}

void apply(const ActuationFit& fit, RobotDescription& robot) {
  robot.actuation = fit.actuation;
  if (robot.friction && fit.friction_scale.size() == robot.friction->p1.size()) {
    // Friction never adds energy.
    robot.friction->p1 = robot.friction->p1.cwiseProduct(fit.friction_scale.cwiseMax(0));
  }
  const auto n = static_cast<Index>(robot.joint_count());
  if (!robot.torque_sensor) {
    robot.torque_sensor = TorqueSensor{.gain = JointVector::Ones(n), .offset = JointVector::Zero(n)};
  }
  robot.torque_sensor->noise = fit.noise;
  if (fit.motor_inertia.size() == n) robot.motor_inertia = fit.motor_inertia;
}

}  // namespace multipanda
