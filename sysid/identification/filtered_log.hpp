#pragma once

#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "sysid/measured/measured_log.hpp"

namespace multipanda {

// Butterworth low pass of even order, by the bilinear transform with a prewarped cut-off, as second-order
// sections. Columns are signals, rows samples.
class LowPass {
 public:
  // Throws std::invalid_argument unless the order is even and 0 < cutoff_hz < rate_hz / 2.
  LowPass(int order, double cutoff_hz, double rate_hz);

  // Filters forward and backward: zero phase, squared gain. Ends are extended by reflection about the end
  // point, three times the filter's length. The states start as if the first value had always been there.
  Eigen::MatrixXd zero_phase(const Eigen::MatrixXd& signals) const;

 private:
  struct Section {
    double b0, b1, b2, a1, a2;
  };
  void run(double* values, Eigen::Index count) const;
  std::vector<Section> sections_;
};

// A log filtered by the protocol that all figures of identification use:
//   1. every column is interpolated linearly to 1 ms on the stamps;
//   2. q, dq and tau pass a Butterworth filter of order 4 at 10 Hz, forward and backward;
//   3. ddq is the central difference of dq filtered at 6 Hz in the same way;
//   4. 200 samples at each end are left out, and every 10th of the others is `kept`.
// Laws with memory run over the whole series at 1 ms.
struct FilteredLog {
  std::string source;
  std::optional<Eigen::Vector3d> gravity_B;  // in its base [m/s^2]; none: given by the caller
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

// How far every joint moves, all logs together (n) [rad].
Eigen::VectorXd travel_of(std::span<const FilteredLog> logs);

// Period of a repetitive motion, in kept rows; 0: not repetitive. A held-out block is no test on new motion
// if another block contains the same motion.
Eigen::Index repeated_after(const FilteredLog& log);

// A stretch of kept rows, and the block that it belongs to.
struct BlockRange {
  std::size_t block = 0;
  Eigen::Index begin = 0, end = 0;  // kept rows
};

// The log cut into `blocks` parts by time, or by phase if the motion is repetitive, so that no part contains
// motion of another one.
std::vector<BlockRange> block_ranges(const FilteredLog& log, std::size_t blocks);

}  // namespace multipanda
