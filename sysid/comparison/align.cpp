#include "sysid/comparison/align.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include <yaml-cpp/yaml.h>

#include "sysid/identification/filtered_log.hpp"

namespace multipanda {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kStep = 0.001;        // of the common time axis [s]
constexpr Index kCoarse = 10;          // samples of one step of the first search
constexpr double kTrusted = 0.5;       // smallest correlation at which a lag is applied
constexpr double kLeastOverlap = 0.1;  // [s]

std::string text(const char* format, auto... values) {
  char buffer[240];
  std::snprintf(buffer, sizeof buffer, format, values...);
  return buffer;
}

// Rows at the times t [s], which must not decrease, interpolated linearly between the log's samples.
MatrixXd resampled(const VectorXd& log_t, const MatrixXd& values, const VectorXd& t) {
  MatrixXd out(t.size(), values.cols());
  Index k = 0;
  for (Index i = 0; i < t.size(); ++i) {
    while (k + 2 < log_t.size() && log_t[k + 1] <= t[i]) ++k;
    const double share = std::clamp((t[i] - log_t[k]) / (log_t[k + 1] - log_t[k]), 0.0, 1.0);
    out.row(i) = (1 - share) * values.row(k) + share * values.row(k + 1);
  }
  return out;
}

VectorXd since_start(const MeasuredLog& log) { return log.t.array() - log.t[0]; }

VectorXd grid(double from, double to) {
  const auto N = static_cast<Index>(std::floor((to - from) / kStep + 1e-6)) + 1;
  VectorXd t(N);
  for (Index k = 0; k < N; ++k) t[k] = from + kStep * static_cast<double>(k);
  return t;
}

// On the grid from the log's start.
MatrixXd signal(const MeasuredLog& log, const MatrixXd& values) {
  return resampled(since_start(log), values, grid(0, log.duration()));
}

double liveliest(const MatrixXd& a) {
  const MatrixXd centered = a.rowwise() - a.colwise().mean();
  return std::sqrt(centered.colwise().squaredNorm().maxCoeff() / static_cast<double>(a.rows()));
}

// Subtracts the means of the overlapping parts. The result is 1 where these parts are proportional.
double correlation(const MatrixXd& a, const MatrixXd& b, Index lag) {
  const Index first = std::max<Index>(0, -lag), count = std::min(a.rows(), b.rows() - lag) - first;
  if (count < 2 || 2 * count < std::min(a.rows(), b.rows())) return -1;
  const auto x = a.middleRows(first, count);
  const auto y = b.middleRows(first + lag, count);
  const auto n = static_cast<double>(count);
  const Eigen::RowVectorXd x_sum = x.colwise().sum(), y_sum = y.colwise().sum();
  const double xx = x.squaredNorm() - x_sum.squaredNorm() / n, yy = y.squaredNorm() - y_sum.squaredNorm() / n;
  return xx > 0 && yy > 0 ? (x.cwiseProduct(y).sum() - x_sum.dot(y_sum) / n) / std::sqrt(xx * yy) : 0;
}

MatrixXd thinned(const MatrixXd& a) {
  MatrixXd out(a.rows() / kCoarse, a.cols());
  for (Index k = 0; k < out.rows(); ++k) out.row(k) = a.middleRows(k * kCoarse, kCoarse).colwise().mean();
  return out;
}

Index best_lag(const MatrixXd& a, const MatrixXd& b, Index from, Index to) {
  Index best = 0;
  double highest = -2;
  for (Index lag = from; lag <= to; ++lag) {
    const double r = correlation(a, b, lag);
    // Of equal values, take the one nearer to zero lag.
    if (r > highest + 1e-12 || (r > highest - 1e-12 && std::abs(lag) < std::abs(best))) {
      highest = std::max(r, highest);
      best = lag;
    }
  }
  return best;
}

struct Found {
  double lag = 0, correlation = 0;  // [samples]
  bool at_edge = false;
};

Found search(const MatrixXd& a, const MatrixXd& b, Index most) {
  const MatrixXd coarse_a = thinned(a), coarse_b = thinned(b);
  const Index coarse = kCoarse * best_lag(coarse_a, coarse_b, -(most / kCoarse), most / kCoarse);
  const Index lag =
      best_lag(a, b, std::max(-most, coarse - 2 * kCoarse), std::min(most, coarse + 2 * kCoarse));
  const double before = correlation(a, b, lag - 1), at = correlation(a, b, lag),
               after = correlation(a, b, lag + 1);
  double share = 0;
  const double bend = before - 2 * at + after;
  if (before > -1 && after > -1 && bend < 0) share = std::clamp(0.5 * (before - after) / bend, -0.5, 0.5);
  if (std::abs(share) < 1e-3) share = 0;  // removes rounding errors where both sides are equal
  return {static_cast<double>(lag) + share, at, most > 0 && std::abs(lag) == most};
}

// Whether both logs are runs of scenes that request the same motion at the same times.
bool same_timeline(const MeasuredLog& a, const MeasuredLog& b) {
  const auto timeline = [](const MeasuredLog& log) -> std::string {
    try {
      const YAML::Node node = YAML::Load(log.scene_text)["timeline"];
      return node && node.size() > 0 ? YAML::Dump(node) : "";
    } catch (const YAML::Exception&) {
      return "";
    }
  };
  if (a.scene_text.empty() || b.scene_text.empty()) return false;
  const std::string text = timeline(a);
  return !text.empty() && text == timeline(b);
}

void find_lag(const MeasuredLog& real, const MeasuredLog& sim, const AlignOptions& options,
              AlignedPair& pair) {
  struct By {
    const char* name;
    const MatrixXd MeasuredLog::*values;
    double lively;  // smallest standard deviation that counts as motion, taken from the joint that moves most
  };
  static constexpr By kCandidates[] = {
      {"dq", &MeasuredLog::dq, 0.01}, {"q", &MeasuredLog::q, 0.002}, {"tau", &MeasuredLog::tau, 0.2}};
  pair.aligned_by = "start";
  for (const By& by : kCandidates) {
    if ((real.*by.values).rows() == 0 || (sim.*by.values).rows() == 0) continue;
    const MatrixXd a = signal(real, real.*by.values), b = signal(sim, sim.*by.values);
    if (std::min(liveliest(a), liveliest(b)) < by.lively) continue;
    const Found found = search(a, b, std::lround(options.max_lag_s / kStep));
    pair.aligned_by = by.name;
    pair.correlation = found.correlation;
    if (found.correlation < kTrusted) {
      pair.aligned_by = "start";
      pair.warnings.push_back(
          text("the logs differ too much (best correlation of %s is %.2f, expected "
               "above %.1f): aligned at their starts; check that they show the same task",
               by.name, found.correlation, kTrusted));
      return;
    }
    pair.lag_s = kStep * found.lag;
    pair.measured_lag_s = pair.lag_s;
    if (found.at_edge) {
      pair.warnings.push_back(
          text("the lag of %.3f s is the largest in the searched range; the true lag may be larger: raise "
               "--max-lag",
               pair.lag_s));
    }
    return;
  }
  pair.warnings.push_back("one of the logs contains no motion: both are aligned at their starts");
}

}  // namespace

const std::vector<ComparedQuantity>& quantities() {
  static const std::vector<ComparedQuantity> all{
      {"q", "joint position", "rad", true, 0.06},       {"dq", "joint velocity", "rad/s", true, 0.05},
      {"tau", "joint torque", "N m", true, 1.3},        {"x_EE", "end-effector position", "m", false, 0.013},
      {"F_EE", "end-effector force", "N", false, 1.7},  {"C_err", "control error", "N m", true, 0.6},
      {"M_EE", "end-effector moment", "N m", false, 0},
  };
  return all;
}

MatrixXd series_of(const MeasuredLog& log, const ComparedQuantity& quantity) {
  const std::string name = quantity.name;
  if (name == "q") return log.q;
  if (name == "dq") return log.dq;
  if (name == "tau") return log.tau;
  if (name == "x_EE") return log.x_EE;
  if (name == "C_err") return log.control_error();
  if (log.F_EE.rows() == 0) return {};
  return name == "F_EE" ? log.F_EE.leftCols(3) : log.F_EE.rightCols(3);
}

MatrixXd even_series_of(const MeasuredLog& log, const ComparedQuantity& quantity, double low_pass_hz) {
  const MatrixXd values = series_of(log, quantity);
  if (values.rows() == 0) return {};
  const MatrixXd even = signal(log, values);
  return low_pass_hz > 0 ? LowPass(2, low_pass_hz, 1 / kStep).zero_phase(even) : even;
}

AlignedPair align(const MeasuredLog& real, const MeasuredLog& sim, const AlignOptions& options) {
  if (real.joints() != sim.joints()) {
    throw LogRefused(real.source + " has " + std::to_string(real.joints()) + " joints, " + sim.source +
                     " has " + std::to_string(sim.joints()) + ": the logs are of different robots");
  }
  AlignedPair pair;
  pair.real_source = real.source;
  pair.sim_source = sim.source;
  find_lag(real, sim, options, pair);
  if (options.lag_s) {
    pair.lag_s = *options.lag_s;
    pair.aligned_by = "given";
  } else if (options.trust_timeline && same_timeline(real, sim)) {
    pair.lag_s = real.t[0] - sim.t[0];
    pair.aligned_by = "timeline";
  }
  // Near the ends of a log the filter has data on one side only.
  const double margin = options.low_pass_hz > 0 ? 2 / options.low_pass_hz : 0;
  double from = margin + std::max(0.0, -pair.lag_s);
  double to = std::min(real.duration(), sim.duration() - pair.lag_s) - margin;
  const double common_from = from, common_to = to;
  if (options.window_s)
    from = std::max(from, options.window_s->first), to = std::min(to, options.window_s->second);
  if (to - from < kLeastOverlap) {
    std::string asked;
    if (options.window_s)
      asked = text(" the window of %.3g to %.3g s with", options.window_s->first, options.window_s->second);
    throw LogRefused(text("%s and %s overlap too little:", real.source.c_str(), sim.source.c_str()) + asked +
                     text(" %.3g to %.3g s of the real log (lag %.3g s), expected at least %.1f s",
                          common_from, std::max(common_from, common_to), pair.lag_s, kLeastOverlap));
  }
  pair.t = grid(from, to);
  const VectorXd real_t = since_start(real), sim_t = since_start(sim), shifted = pair.t.array() + pair.lag_s;
  for (const ComparedQuantity& quantity : quantities()) {
    AlignedPair::Series series;
    MatrixXd in_real = series_of(real, quantity), in_sim = series_of(sim, quantity);
    const bool no_real = in_real.rows() == 0, no_sim = in_sim.rows() == 0;
    if (no_real || no_sim) {
      series.missing = no_real && no_sim ? "missing in both logs"
                       : no_real         ? "missing in the real log"
                                         : "missing in the simulated log";
    } else if (options.low_pass_hz > 0) {
      in_real = even_series_of(real, quantity, options.low_pass_hz);
      in_sim = even_series_of(sim, quantity, options.low_pass_hz);
      series.real = resampled(grid(0, real.duration()), in_real, pair.t);
      series.sim = resampled(grid(0, sim.duration()), in_sim, shifted);
    } else {
      series.real = resampled(real_t, in_real, pair.t);
      series.sim = resampled(sim_t, in_sim, shifted);
    }
    pair.series.push_back(std::move(series));
  }
  return pair;
}

}  // namespace multipanda
