#pragma once

#include <vector>

#include <Eigen/Core>

#include "analysis/measured/measured_log.hpp"

namespace multipanda {

// A log as every figure of identification sees it:
//   1. every column linearly interpolated to 1 ms on the stamps;
//   2. Butterworth order 4, forward and backward, 10 Hz, on q, dq, tau;
//   3. ddq: central difference of dq filtered at 6 Hz in the same way;
//   4. 200 samples at each end are left out, and of the rest every 10th is `kept`.
// Laws with memory run over the whole series at 1 ms.
struct FilteredLog {
  std::string source;
  Eigen::VectorXd t;               // every 1 ms [s] (N)
  Eigen::MatrixXd q, dq, ddq;      // filtered (N x n)
  Eigen::MatrixXd tau, tau_raw;    // filtered; as measured, interpolated [N m] (N x n)
  std::vector<Eigen::Index> kept;  // rows that count

  Eigen::Index joints() const { return q.cols(); }
  Eigen::MatrixXd kept_rows(const Eigen::MatrixXd& series) const;
};

inline constexpr double kProtocolStep = 1e-3;      // [s]
inline constexpr double kProtocolCutoffHz = 10.0;  // q, dq, tau and whatever is compared with tau

// What tau went through, for columns that are to be compared with it (N x anything).
Eigen::MatrixXd protocol_filter(const Eigen::MatrixXd& series);

// Throws LogRefused if the log is shorter than `shortest` [s].
FilteredLog filter_log(const MeasuredLog& log, double shortest);

}  // namespace multipanda
