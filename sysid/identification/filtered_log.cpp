#include "sysid/identification/filtered_log.hpp"

#include <cmath>

#include <fmt/format.h>

#include "sysid/identification/filters.hpp"

namespace multipanda {
namespace {

constexpr Eigen::Index kCut = 200;   // samples left out at each end
constexpr Eigen::Index kEvery = 10;  // one in so many is kept
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

}  // namespace

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

}  // namespace multipanda
