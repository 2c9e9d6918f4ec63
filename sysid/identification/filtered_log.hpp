#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "sysid/measured/measured_log.hpp"

namespace multipanda {

// A log after the protocol that every figure of identification uses:
//   1. every column is interpolated linearly to 1 ms on the stamps;
//   2. q, dq and tau pass a Butterworth filter of order 4 at 10 Hz, forward and backward;
//   3. ddq is the central difference of dq filtered at 6 Hz in the same way;
//   4. 200 samples at each end are left out, and every 10th of the others is `kept`.
// Laws with memory run over the whole series at 1 ms.
struct FilteredLog {
  std::string source;
  std::optional<Eigen::Vector3d> gravity_B;  // in its base [m/s^2]; none: as the caller says
  Eigen::VectorXd t;                         // every 1 ms [s] (N)
  Eigen::MatrixXd q, dq, ddq;                // filtered (N x n)
  Eigen::MatrixXd tau, tau_raw;              // filtered; as measured, interpolated [N m] (N x n)
  std::vector<Eigen::Index> kept;            // rows that are used

  Eigen::Index joints() const { return q.cols(); }
  Eigen::MatrixXd kept_rows(const Eigen::MatrixXd& series) const;
};

inline constexpr double kProtocolStep = 1e-3;      // [s]
inline constexpr double kProtocolCutoffHz = 10.0;  // of q, dq, tau and everything compared with tau

// The filter of tau, for columns that are compared with it (N x anything).
Eigen::MatrixXd protocol_filter(const Eigen::MatrixXd& series);

// Throws LogRefused if the log is shorter than `shortest` [s].
FilteredLog filter_log(const MeasuredLog& log, double shortest);

}  // namespace multipanda
