#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "analysis/measured/measured_log.hpp"

// Two logs of one task on one time axis.
namespace multipanda {

// What is compared. Per joint, or along the three axes of the world.
struct ComparedQuantity {
  const char* name;  // "F_EE"
  const char* what;  // for people
  const char* unit;
  bool per_joint;
  double paper;  // largest RMSE between simulation and real arms in the paper's tasks 1-5; 0: none stated
};
// q, dq, tau (at the sensor, gravity included), x_EE (position in the world), F_EE (estimated force, world
// axes), C_err (control error tau_d - (tau - gravity)), M_EE (estimated moment, world axes).
const std::vector<ComparedQuantity>& quantities();

// Series of a quantity in a log (N x axes); no rows where the log does not tell it.
Eigen::MatrixXd series_of(const MeasuredLog& log, const ComparedQuantity& quantity);

// The same every millisecond from the log's start on, filtered (see AlignOptions).
Eigen::MatrixXd even_series_of(const MeasuredLog& log, const ComparedQuantity& quantity, double low_pass_hz);

struct AlignOptions {
  double max_lag_s = 1.0;       // searched on both sides
  std::optional<double> lag_s;  // given instead of searched
  bool trust_timeline = true;   // false: by cross-correlation in any case
  // Of both series before errors are taken: Butterworth of order 2, forward and backward; 0: none. Noise of
  // sensors is no fault of the simulation. The first and last 2 / low_pass_hz of each log are left out.
  double low_pass_hz = 0;
  std::optional<std::pair<double, double>> window_s;  // from, to: since the real log's start
};

// Real and simulated series every millisecond of the common time, t since the real log's start.
struct AlignedPair {
  std::string real_source, sim_source;
  double lag_s = 0;  // applied: the simulation shows at t + lag what the real log shows at t
  std::optional<double> measured_lag_s;  // by cross-correlation, whether applied or not
  double correlation = 0;                // of the two at this lag, 0 to 1
  std::string aligned_by;  // "dq", "q", "tau"; "timeline", "given", "start" (nothing to align by)
  Eigen::VectorXd t;       // [s] (N)
  struct Series {
    Eigen::MatrixXd real, sim;  // (N x axes); no rows: not in both logs
    std::string missing;        // which of the logs lacks it; empty: neither
  };
  std::vector<Series> series;  // in the order of quantities()
  std::vector<std::string> warnings;
};

// Lag: maximum of the normalised cross-correlation of joint velocities (where the arm hardly moves: of
// positions, else of torques), all joints together,
//   r(L) = sum a_k b_{k+L} / sqrt(sum a_k^2 sum b_{k+L}^2)   over the samples that overlap, at least half
// of the shorter log, their means taken away, on a grid of 1 ms, refined by the parabola through the three
// highest values. A log and itself: exactly 0. It is applied unless both logs come from runs of one timeline:
// their stamps already tell what belongs together, and what correlation then finds is how far one arm trails
// the other, which is a difference to be shown, not to be taken out. Between samples series are interpolated
// linearly. Throws LogRefused: other joints, no common time.
AlignedPair align(const MeasuredLog& real, const MeasuredLog& sim, const AlignOptions& options = {});

}  // namespace multipanda
