#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <optional>

#include "sysid/measured/measured_log.hpp"

namespace multipanda {
namespace {

using Eigen::Index;

std::string text(const char* format, auto... values) {
  char buffer[240];
  std::snprintf(buffer, sizeof buffer, format, values...);
  return buffer;
}

// "file.csv:12: " or "log.mcap, arm left, t = 1.234 s: ".
std::string place(const MeasuredLog& log, std::optional<Index> k = std::nullopt) {
  std::string out = log.source;
  if (k && !log.lines.empty())
    return out + ":" + std::to_string(log.lines[static_cast<std::size_t>(*k)]) + ": ";
  if (!log.arm.empty()) out += ", arm " + log.arm;
  if (k) out += text(", t = %.4g s", log.t[*k]);
  return out + ": ";
}

// The same for warnings, which are already assigned to a log: "line 12: ".
std::string spot(const MeasuredLog& log, Index k) {
  if (!log.lines.empty()) return "line " + std::to_string(log.lines[static_cast<std::size_t>(k)]) + ": ";
  return text("t = %.4g s: ", log.t[k]);
}

template <typename Visit>
void for_each_matrix(MeasuredLog& log, Visit&& visit) {
  visit("q", log.q), visit("dq", log.dq), visit("tau", log.tau), visit("tau_d", log.tau_d);
  visit("tau_cmd", log.tau_cmd), visit("gravity", log.gravity), visit("x_EE", log.x_EE);
  visit("tau_ext", log.tau_ext), visit("contact", log.contact);
  visit("quat_EE", log.quat_EE), visit("F_EE", log.F_EE), visit("F_true", log.F_true);
}

void check_finite(MeasuredLog& log) {
  for (Index k = 0; k < log.samples(); ++k) {
    if (!std::isfinite(log.t[k]))
      throw LogRefused(place(log) + "sample " + std::to_string(k + 1) + " has no time");
  }
  for_each_matrix(log, [&](const std::string& name, const Eigen::MatrixXd& values) {
    if (values.allFinite()) return;
    const Index bad = (values.array() - values.array() != 0).count();
    for (Index k = 0; k < values.rows(); ++k) {
      for (Index j = 0; j < values.cols(); ++j) {
        if (std::isfinite(values(k, j))) continue;
        throw LogRefused(place(log, k) + name + std::to_string(j + 1) + " is not a number, one of " +
                         std::to_string(bad) + " such values; cut the log before or after them");
      }
    }
  });
}

void check_order(MeasuredLog& log) {
  if (log.samples() > 0 && log.t[0] < 0)
    throw LogRefused(place(log, 0) + text("time is negative (%.6g s), expected seconds from 0", log.t[0]));
  std::vector<Index> kept;
  for (Index k = 0; k < log.samples(); ++k) {
    const double before = kept.empty() ? -1.0 : log.t[kept.back()];
    if (!kept.empty() && log.t[k] < before) {
      throw LogRefused(place(log, k) +
                       text("time decreases from %.6f to %.6f s, expected each sample to be later than the "
                            "one before; does the file hold several recordings?",
                            before, log.t[k]));
    }
    if (kept.empty() || log.t[k] > before) kept.push_back(k);
  }
  const Index twice = log.samples() - static_cast<Index>(kept.size());
  if (twice == 0) return;
  if (twice * 10 > log.samples()) {
    throw LogRefused(place(log) +
                     text("%ld of %ld samples have the same time as the one before; is the time column "
                          "rounded?",
                          static_cast<long>(twice), static_cast<long>(log.samples())));
  }
  log.warnings.push_back(std::to_string(twice) +
                         " samples have the same time as the one before and are left out");
  log.t = Eigen::VectorXd(log.t(kept));
  for_each_matrix(log, [&](const std::string&, Eigen::MatrixXd& values) {
    if (values.rows() > 0) values = Eigen::MatrixXd(values(kept, Eigen::all));
  });
  std::vector<std::size_t> lines;
  for (const Index k : kept) {
    if (!log.lines.empty()) lines.push_back(log.lines[static_cast<std::size_t>(k)]);
  }
  log.lines = std::move(lines);
}

// The unit in which this step is one of 0.5 to 50 ms.
const char* unit_of(double step) {
  if (step >= 5e5) return ": is time in nanoseconds? It must be in seconds";
  if (step >= 500) return ": is time in microseconds? It must be in seconds";
  return step >= 0.5 ? ": is time in milliseconds? It must be in seconds" : "";
}

void check_sampling(MeasuredLog& log, double refuse_above_gap_s) {
  const double step = log.period();
  if (step > 0.05) {
    throw LogRefused(place(log) +
                     text("samples are %.3g s apart (median), expected about 0.001 s, at most 0.05 s%s", step,
                          unit_of(step)));
  }
  if (log.duration() < 0.1) {
    throw LogRefused(place(log) + text("too short: %ld samples, %.3f s, expected at least 0.1 s%s",
                                       static_cast<long>(log.samples()), log.duration(),
                                       log.samples() == 50
                                           ? " (libfranka keeps 50 samples unless Robot's log_size is larger)"
                                           : ""));
  }
  if (step > 0.0051)
    log.warnings.push_back(
        text("sampled every %.3g ms, expected about 1 ms; faster motion is lost", 1e3 * step));
  Index at = 0, gaps = 0;
  double longest = 0;
  for (Index k = 1; k < log.samples(); ++k) {
    const double width = log.t[k] - log.t[k - 1];
    if (width > 5 * step) ++gaps;
    if (width > longest) longest = width, at = k;
  }
  if (longest > refuse_above_gap_s && longest > 5 * step) {
    throw LogRefused(place(log, at) +
                     text("a gap of %.4g s before this sample (%ld gaps in total, usual step %.3g ms); "
                          "cut the log there or record it again",
                          longest, static_cast<long>(gaps), 1e3 * step));
  }
  if (gaps > 0) {
    log.warnings.push_back(spot(log, at) + text("gaps in time: %ld, the longest %.3g ms (usual step %.3g ms)",
                                                static_cast<long>(gaps), 1e3 * longest, 1e3 * step));
  }
}

// Factor from joint j's velocities to the slope of its positions (dq over dq/dt), by least squares on windows
// of about 50 ms, and their correlation.
struct Slope {
  double ratio = 1, correlation = 1;
};

Slope slope_of(const MeasuredLog& log, Index j) {
  double dd = 0, di = 0, ii = 0;
  const Index stride = std::max<Index>(1, static_cast<Index>(0.05 / log.period()));
  for (Index k = 0; k + stride < log.samples(); k += stride) {
    const double moved = log.q(k + stride, j) - log.q(k, j);
    double integral = 0;
    for (Index i = k; i < k + stride; ++i)
      integral += 0.5 * (log.dq(i, j) + log.dq(i + 1, j)) * (log.t[i + 1] - log.t[i]);
    dd += moved * moved, di += moved * integral, ii += integral * integral;
  }
  if (dd == 0) return {};
  if (ii == 0) return {0, 0};
  return {di / dd, di / std::sqrt(dd * ii)};
}

std::string guess(double ratio) {
  const double size = std::abs(ratio);
  const auto near = [&](double value) { return size > 0.8 * value && size < 1.25 * value; };
  if (ratio < 0) return "; one of the two has the opposite sign";
  if (near(180 / std::numbers::pi)) return "; is dq in degrees per second? Expected rad/s, and q in rad";
  if (near(std::numbers::pi / 180)) return "; is q in degrees? Expected rad";
  if (near(30 / std::numbers::pi)) return "; is dq in revolutions per minute (rpm)? Expected rad/s";
  if (near(1000)) return "; is time in milliseconds? Expected seconds";
  if (near(1e6)) return "; is time in microseconds? Expected seconds";
  if (near(1e9)) return "; is time in nanoseconds? Expected seconds";
  return "";
}

void check_units(MeasuredLog& log) {
  constexpr double kLargestAngle = 4 * std::numbers::pi, kFastest = 30;
  for (Index j = 0; j < log.joints(); ++j) {
    Index at = 0;
    const double largest = log.q.col(j).cwiseAbs().maxCoeff(&at);
    if (largest > kLargestAngle) {
      throw LogRefused(place(log, at) +
                       text("q%ld reaches %.4g, more than any arm's joint turns in rad; is it in degrees?",
                            static_cast<long>(j + 1), log.q(at, j)));
    }
  }
  if (log.dq.rows() == 0) return;
  for (Index j = 0; j < log.joints(); ++j) {
    if (log.q.col(j).maxCoeff() - log.q.col(j).minCoeff() < 0.05)
      continue;  // too little motion for a useful slope
    const Slope slope = slope_of(log, j);
    const std::string which =
        text("dq%ld is %.3g times the slope of q%ld (correlation %.2f)", static_cast<long>(j + 1),
             slope.ratio, static_cast<long>(j + 1), slope.correlation);
    if (slope.correlation < 0.8 || slope.ratio < 0.8 || slope.ratio > 1.25)
      throw LogRefused(place(log) + which + ", expected 1" + guess(slope.ratio));
    if (slope.correlation < 0.98 || slope.ratio < 0.95 || slope.ratio > 1.05)
      log.warnings.push_back(which + ", expected 1");
  }
  for (Index j = 0; j < log.joints(); ++j) {
    Index at = 0;
    if (log.dq.col(j).cwiseAbs().maxCoeff(&at) > kFastest) {
      throw LogRefused(place(log, at) +
                       text("dq%ld reaches %.4g, faster than any arm's joint in rad/s; is it in "
                            "degrees per second?",
                            static_cast<long>(j + 1), log.dq(at, j)));
    }
  }
}

// Columns, and stretches of all columns, that do not change while the arm moves.
void check_frozen(MeasuredLog& log, double refuse_above_gap_s) {
  for (Index j = 0; j < log.joints(); ++j) {
    const double moved = log.q.col(j).maxCoeff() - log.q.col(j).minCoeff();
    if (log.tau.rows() > 0 && moved > 0.05 && (log.tau.col(j).array() == log.tau(0, j)).all()) {
      throw LogRefused(place(log) +
                       text("tau%ld is %.6g in every sample while joint %ld moves by %.3g rad; the "
                            "column is not a measurement",
                            static_cast<long>(j + 1), log.tau(0, j), static_cast<long>(j + 1), moved));
    }
    if (log.dq.rows() == 0) continue;
    const double speed = std::sqrt(log.dq.col(j).squaredNorm() / static_cast<double>(log.samples()));
    if (moved == 0 && speed > 0.02) {
      throw LogRefused(place(log) +
                       text("q%ld is %.6g in every sample while dq%ld is %.3g rad/s (RMS); the column "
                            "is frozen",
                            static_cast<long>(j + 1), log.q(0, j), static_cast<long>(j + 1), speed));
    }
  }
  if (log.dq.rows() == 0) return;
  double longest = 0;
  Index at = 0, repeated = 0;
  for (Index k = 1, begin = 0, held = 0; k < log.samples(); ++k) {
    const bool equal = log.q.row(k) == log.q.row(k - 1) && log.dq.row(k) == log.dq.row(k - 1);
    const bool same = equal && log.dq.row(k).cwiseAbs().maxCoeff() > 0.02;
    // At rest, too, no sensor gives the same numbers twice; a simulation without noise does, for long.
    if (!equal || (log.tau.rows() > 0 && log.tau.row(k) != log.tau.row(k - 1))) held = k;
    if (same || (held < k && log.t[k] - log.t[held] < 0.02)) ++repeated;
    if (!same) begin = k;
    if (same && log.t[k] - log.t[begin] > longest) longest = log.t[k] - log.t[begin], at = begin;
  }
  if (longest > refuse_above_gap_s) {
    throw LogRefused(place(log, at) +
                     text("positions and velocities repeat for %.4g s from here while the arm "
                          "moves; the recorder received no new data: cut the log there",
                          longest));
  }
  if (longest > 0.02) {
    log.warnings.push_back(spot(log, at) + text("positions and velocities repeat for %.3g ms from here while "
                                                "the arm moves",
                                                1e3 * longest));
  } else if (repeated * 5 > log.samples()) {
    log.warnings.push_back(text(
        "%.0f %% of the samples repeat the one before; the log was recorded faster than the arm was measured",
        100.0 * static_cast<double>(repeated) / static_cast<double>(log.samples())));
  }
}

}  // namespace

void check_measured(MeasuredLog& log, double refuse_above_gap_s) {
  if (log.samples() < 2)
    throw LogRefused(place(log) + "too short: " + std::to_string(log.samples()) + " samples");
  check_finite(log);
  check_order(log);
  check_sampling(log, refuse_above_gap_s);
  check_frozen(log, refuse_above_gap_s);  // before the slopes, which a frozen column does not have
  check_units(log);
}

void check_robot(MeasuredLog& log, const RobotRanges& ranges) {
  constexpr double kSlack = 0.1;  // tolerance for encoders and stops [rad]
  const auto n = std::max({ranges.q_min.size(), ranges.dq_max.size(), ranges.tau_max.size()});
  if (n != log.joints()) {
    throw LogRefused(place(log) + std::to_string(log.joints()) + " joints, expected " + std::to_string(n) +
                     " for robot '" + ranges.robot + "'; check that the log is from this robot");
  }
  for (Index j = 0; j < n; ++j) {
    if (ranges.q_min.size() > 0) {
      Index low = 0, high = 0;
      const double least = log.q.col(j).minCoeff(&low), most = log.q.col(j).maxCoeff(&high);
      const bool below = least < ranges.q_min[j] - kSlack;
      if (below || most > ranges.q_max[j] + kSlack) {
        throw LogRefused(place(log, below ? low : high) +
                         text("q%ld is %.4g rad, outside the range %.4g to %.4g of robot '%s'; check the "
                              "robot, and that the unit is rad",
                              static_cast<long>(j + 1), below ? least : most, ranges.q_min[j],
                              ranges.q_max[j], ranges.robot.c_str()));
      }
    }
    const auto compare = [&](const Eigen::MatrixXd& values, const Eigen::VectorXd& limit, const char* name,
                             const char* unit) {
      if (limit.size() == 0 || values.rows() == 0) return;
      Index at = 0;
      const double largest = values.col(j).cwiseAbs().maxCoeff(&at);
      if (largest > 2 * limit[j]) {
        throw LogRefused(
            place(log, at) +
            text("%s%ld reaches %.4g %s, robot '%s' has at most %.4g; check the robot and the unit", name,
                 static_cast<long>(j + 1), values(at, j), unit, ranges.robot.c_str(), limit[j]));
      }
      if (largest > 1.1 * limit[j]) {
        log.warnings.push_back(text("%s%ld reaches %.4g %s, robot '%s' has at most %.4g", name,
                                    static_cast<long>(j + 1), values(at, j), unit, ranges.robot.c_str(),
                                    limit[j]));
      }
    };
    compare(log.dq, ranges.dq_max, "dq", "rad/s");
    compare(log.tau, ranges.tau_max, "tau", "N m");
  }
}

}  // namespace multipanda
