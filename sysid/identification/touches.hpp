#pragma once

#include <optional>
#include <vector>

#include "sysid/identification/predict.hpp"

// External torque of a recorded arm by the loop's observer, and when something touched the arm.
namespace multipanda {

// tau_ext_hat of ExternalForceObserver along the log (N x n) [N m]. Throws as `predict`.
Eigen::MatrixXd observed_torque(const MeasuredLog& log, const RobotDescription& robot,
                                const PredictOptions& options);

// A touch is a quick change: of any joint, what a low-pass of `stage_hz` leaves of the external torque
// differs by more than `threshold` from its own low-pass of `tare_hz`, which follows errors of the model and
// friction. On 90 Hz data of an arm that holds its pose, 7, 3 Hz and 0.5 N m are in the middle between the
// smallest of 45 touches (1.0) and the largest signal without one (0.34). Moving arms show friction.
struct TouchOptions {
  double stage_hz = 7, tare_hz = 3;  // first order; a stage of 0: none
  double threshold = 0.5;            // [N m]
};

// Compared with `contact` of the log: a touch may be found 50 ms before its label, which a person's glove
// gave, and its release up to 300 ms after it.
struct JudgedTouches {
  std::size_t touches = 0, missed = 0, false_alarms = 0;
  std::vector<double> delays;  // of those found, after the label [s]
  double quiet = 0;  // largest signal without a touch, the least threshold without false alarms [N m]
};

struct Touches {
  std::vector<double> starts;           // [s]
  std::optional<JudgedTouches> judged;  // none: the log has no labels
};

// `tau_ext` (N x n): at the log's samples.
Touches find_touches(const MeasuredLog& log, const Eigen::MatrixXd& tau_ext, const TouchOptions& options);

}  // namespace multipanda
