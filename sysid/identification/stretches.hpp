#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "core/types/joints.hpp"
#include "models/robot_description.hpp"
#include "sysid/measured/measured_log.hpp"

namespace multipanda {

// Rows of one log without a gap: the commands and the values that they are compared with.
struct CommandedStretch {
  double period = 0.001;     // [s]
  Eigen::MatrixXd command;   // (N x n)
  Eigen::MatrixXd beyond;    // tau_J[k+1] - g(q_k) + I_m ddq: tracked torque less friction (N x n)
  Eigen::MatrixXd q;         // (N x n)
  Eigen::MatrixXd ddq;       // mean over 3 periods [rad/s^2] (N x n)
  Eigen::MatrixXd friction;  // of the prior's table at dq_(k+1) (N x n); no columns: the prior has no table
};

// The log's stretches of at least `shortest` [s]. The prior's sensor gains, sensor offsets and motor inertia
// are subtracted. Throws LogRefused for another number of joints, and without commanded torque or gravity.
std::vector<CommandedStretch> commanded_stretches(const MeasuredLog& log, const RobotDescription& prior,
                                                  double shortest);

// Stretches of logs that a fit by rollouts replays.

struct RolloutWindow {
  std::size_t log = 0;
  Eigen::Index first = 0;  // row of the start state; compared rows: first + 1 to first + length
  Eigen::Index length = 0;
  JointVector q, dq;  // start state, smoothed (n x 1)
};

// At most `most` windows of `seconds`, spread evenly, without a gap inside or in the 0.1 s before. `usable`
// may exclude rows (empty: all are usable). Start states are second-order fits over nine samples.
std::vector<RolloutWindow> choose_windows(std::span<const MeasuredLog> logs, double seconds, std::size_t most,
                                          const std::vector<std::vector<char>>& usable = {});

}  // namespace multipanda
