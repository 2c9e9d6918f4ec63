#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "sysid/measured/measured_log.hpp"

// Aligns two logs of one task in time.
namespace multipanda {

// A quantity that is compared, per joint or along the three axes of the world.
struct ComparedQuantity {
  const char* name;  // "F_EE"
  const char* what;  // human-readable name
  const char* unit;
  bool per_joint;
  double paper;  // largest RMSE between simulation and real arms in the paper's tasks 1-5; 0: none stated
};
// q, dq, tau (at the sensor, gravity included), x_EE (position in the world), F_EE (estimated force, world
// axes), C_err (control error tau_d - (tau - gravity)), M_EE (estimated moment, world axes).
const std::vector<ComparedQuantity>& quantities();

// Series of a quantity in a log (N x axes); no rows if the log does not contain it.
Eigen::MatrixXd series_of(const MeasuredLog& log, const ComparedQuantity& quantity);

// The same series every millisecond from the log's start, filtered (see AlignOptions).
Eigen::MatrixXd even_series_of(const MeasuredLog& log, const ComparedQuantity& quantity, double low_pass_hz);

struct AlignOptions {
  double max_lag_s = 1.0;       // searched in both directions
  std::optional<double> lag_s;  // fixed lag, which replaces the search
  bool trust_timeline = true;   // false: always by cross-correlation
  // Low pass of both series before errors are computed: Butterworth of order 2, forward and backward; 0:
  // none. It removes sensor noise, which no model predicts. The first and last 2 / low_pass_hz of each log
  // are left out.
  double low_pass_hz = 0;
  std::optional<std::pair<double, double>> window_s;  // from, to: since the real log's start
};

// Real and simulated series every millisecond of the common time, t since the real log's start.
struct AlignedPair {
  std::string real_source, sim_source;
  double lag_s = 0;  // applied lag: the simulation at t + lag corresponds to the real log at t
  std::optional<double> measured_lag_s;  // by cross-correlation, also if it is not applied
  double correlation = 0;                // of both logs at this lag, 0 to 1
  std::string aligned_by;  // "dq", "q", "tau"; "timeline", "given", "start" (nothing to align by)
  Eigen::VectorXd t;       // [s] (N)
  struct Series {
    Eigen::MatrixXd real, sim;  // (N x axes); no rows unless both logs have the quantity
    std::string missing;        // which of the logs lacks the quantity; empty: neither
  };
  std::vector<Series> series;  // in the order of quantities()
  std::vector<std::string> warnings;
};

// Lag: maximum of the normalized cross-correlation of the joint velocities, all joints together. Positions
// are used if the arm hardly moves, and torques if it does not move at all.
//   r(L) = sum a_k b_{k+L} / sqrt(sum a_k^2 sum b_{k+L}^2)
// The sums run over the overlapping samples (at least half of the shorter log) with their means subtracted,
// on a grid of 1 ms, refined by the parabola through the three highest values. A log and itself give
// exactly 0. The lag is applied unless both logs are runs of one timeline. Their stamps then align them,
// and the lag that remains is how far one arm trails the other: a difference to report, not to remove.
// Series are interpolated linearly between samples. Throws LogRefused if the joint counts differ or the
// logs do not overlap.
AlignedPair align(const MeasuredLog& real, const MeasuredLog& sim, const AlignOptions& options = {});

}  // namespace multipanda
