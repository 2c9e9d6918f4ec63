#include "sysid/identification/filtered_log.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <tuple>

#include <fmt/format.h>

namespace multipanda {
namespace {

constexpr Eigen::Index kCut = 200;   // samples left out at each end
constexpr Eigen::Index kEvery = 10;  // every 10th sample is kept
constexpr double kAccelerationCutoffHz = 6.0;

Eigen::MatrixXd interpolated(const Eigen::VectorXd& t, const Eigen::MatrixXd& values,
                             const Eigen::VectorXd& at) {
  Eigen::MatrixXd out(at.size(), values.cols());
  Eigen::Index k = 0;
  for (Eigen::Index i = 0; i < at.size(); ++i) {
    while (k + 2 < t.size() && t[k + 1] <= at[i]) ++k;
    const double share = std::clamp((at[i] - t[k]) / (t[k + 1] - t[k]), 0.0, 1.0);
    out.row(i) = (1 - share) * values.row(k) + share * values.row(k + 1);
  }
  return out;
}

using Eigen::Index;

constexpr Index kShortest = 100;      // of a period [kept rows of 10 ms]
constexpr Index kStep = 5;            // between tried periods and compared rows
constexpr double kSame = 0.03;        // largest difference of a joint's position [rad]
constexpr double kMovingJoint = 0.1;  // of the fastest joint [rad/s]
constexpr double kShare = 0.2;        // of the moving rows, which the repetition must cover

}  // namespace

LowPass::LowPass(int order, double cutoff_hz, double rate_hz) {
  if (order < 2 || order % 2 != 0 || !(cutoff_hz > 0 && cutoff_hz < rate_hz / 2)) {
    throw std::invalid_argument("low pass: expected an even order and a cut-off below half the rate");
  }
  const double k = std::tan(std::numbers::pi * cutoff_hz / rate_hz);  // cut-off, prewarped
  for (int pair = 0; pair < order / 2; ++pair) {
    const double damping = 2 * std::sin((2 * pair + 1) * std::numbers::pi / (2 * order));  // 1/Q of the poles
    const double norm = 1 / (1 + damping * k + k * k);
    const double b = k * k * norm;
    sections_.push_back({b, 2 * b, b, 2 * (k * k - 1) * norm, (1 - damping * k + k * k) * norm});
  }
}

// Direct form II transposed; every section passes a constant unchanged.
void LowPass::run(double* values, Eigen::Index count) const {
  const double first = values[0];
  for (const Section& s : sections_) {
    double z1 = (1 - s.b0) * first, z2 = (s.b2 - s.a2) * first;
    for (Eigen::Index i = 0; i < count; ++i) {
      const double x = values[i], y = s.b0 * x + z1;
      z1 = s.b1 * x - s.a1 * y + z2;
      z2 = s.b2 * x - s.a2 * y;
      values[i] = y;
    }
  }
}

Eigen::MatrixXd LowPass::zero_phase(const Eigen::MatrixXd& signals) const {
  const Eigen::Index count = signals.rows();
  Eigen::MatrixXd out(count, signals.cols());
  if (count == 0) return out;
  const Eigen::Index length = 2 * static_cast<Eigen::Index>(sections_.size()) + 1;
  const Eigen::Index edge = std::min(3 * length, count - 1);
  Eigen::VectorXd x(count + 2 * edge);
  for (Eigen::Index c = 0; c < signals.cols(); ++c) {
    const auto signal = signals.col(c);
    x.segment(edge, count) = signal;
    for (Eigen::Index i = 1; i <= edge; ++i) {
      x[edge - i] = 2 * signal[0] - signal[i];
      x[edge + count - 1 + i] = 2 * signal[count - 1] - signal[count - 1 - i];
    }
    for (int way = 0; way < 2; ++way) {
      run(x.data(), x.size());
      x.reverseInPlace();
    }
    out.col(c) = x.segment(edge, count);
  }
  return out;
}

Eigen::MatrixXd FilteredLog::kept_rows(const Eigen::MatrixXd& series) const {
  return series(kept, Eigen::all);
}

Eigen::MatrixXd protocol_filter(const Eigen::MatrixXd& series) {
  return LowPass(4, kProtocolCutoffHz, 1 / kProtocolStep).zero_phase(series);
}

FilteredLog filter_log(const MeasuredLog& log, double shortest) {
  if (log.samples() < 3 || log.duration() < shortest) {
    throw LogRefused(fmt::format("{}: {} samples in {:.3g} s are too short, expected at least {:.3g} s",
                                 log.source, log.samples(), log.duration(), shortest));
  }
  FilteredLog out;
  out.source = log.source;
  out.gravity_B = log.gravity_B;
  const auto count = static_cast<Eigen::Index>(std::floor(log.duration() / kProtocolStep + 1e-6)) + 1;
  out.t =
      log.t[0] + kProtocolStep * Eigen::VectorXd::LinSpaced(count, 0, static_cast<double>(count - 1)).array();
  const Eigen::MatrixXd dq = interpolated(log.t, log.dq, out.t);
  out.tau_raw = interpolated(log.t, log.tau, out.t);
  out.q = protocol_filter(interpolated(log.t, log.q, out.t));
  out.dq = protocol_filter(dq);
  out.tau = protocol_filter(out.tau_raw);
  const Eigen::MatrixXd smooth = LowPass(4, kAccelerationCutoffHz, 1 / kProtocolStep).zero_phase(dq);
  out.ddq.setZero(count, dq.cols());
  out.ddq.middleRows(1, count - 2) =
      (smooth.bottomRows(count - 2) - smooth.topRows(count - 2)) / (2 * kProtocolStep);
  out.ddq.row(0) = out.ddq.row(1);
  out.ddq.row(count - 1) = out.ddq.row(count - 2);
  for (Eigen::Index i = kCut; i < count - kCut; i += kEvery) out.kept.push_back(i);
  return out;
}

Eigen::VectorXd travel_of(std::span<const FilteredLog> logs) {
  Eigen::VectorXd low = logs.front().q.colwise().minCoeff(), high = logs.front().q.colwise().maxCoeff();
  for (const FilteredLog& log : logs) {
    low = low.cwiseMin(log.q.colwise().minCoeff().transpose());
    high = high.cwiseMax(log.q.colwise().maxCoeff().transpose());
  }
  return high - low;
}

Index repeated_after(const FilteredLog& log) {
  const Eigen::MatrixXd q = log.kept_rows(log.q), dq = log.kept_rows(log.dq);
  const auto moves = [&](Index row) { return dq.row(row).cwiseAbs().maxCoeff() > kMovingJoint; };
  Index moving = 0;
  for (Index row = 0; row < q.rows(); row += kStep) moving += moves(row) ? 1 : 0;
  Index best = 0, most = 0;
  for (Index lag = kShortest; lag < q.rows(); lag += kStep) {
    Index same = 0;
    for (Index row = lag; row < q.rows(); row += kStep) {
      if (moves(row) && (q.row(row) - q.row(row - lag)).cwiseAbs().maxCoeff() < kSame) ++same;
    }
    if (same > most) std::tie(best, most) = std::tuple(lag, same);
  }
  return static_cast<double>(most) >= kShare * static_cast<double>(std::max<Index>(1, moving)) ? best : 0;
}

std::vector<BlockRange> block_ranges(const FilteredLog& log, std::size_t blocks) {
  const auto count = static_cast<Index>(log.kept.size()), parts = static_cast<Index>(blocks);
  const Index repeated = blocks > 1 ? repeated_after(log) : 0, period = repeated > 0 ? repeated : count;
  std::vector<BlockRange> out;
  for (Index start = 0; start < count; start += period) {
    for (Index b = 0; b < parts; ++b) {
      const Index begin = start + period * b / parts, end = std::min(count, start + period * (b + 1) / parts);
      if (begin < end) out.push_back({static_cast<std::size_t>(b), begin, end});
    }
  }
  return out;
}

}  // namespace multipanda
