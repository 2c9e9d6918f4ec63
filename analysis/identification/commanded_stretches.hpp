#pragma once

#include <vector>

#include <Eigen/Core>

#include "analysis/measured/measured_log.hpp"
#include "models/robot_description.hpp"

namespace multipanda {

// Rows of one log without a gap: commands, and what they are compared with.
struct CommandedStretch {
  double period = 0.001;     // [s]
  Eigen::MatrixXd command;   // (N x n)
  Eigen::MatrixXd beyond;    // tau_J[k+1] - g(q_k) + I_m ddq: what is left for tracking less friction (N x n)
  Eigen::MatrixXd friction;  // of the prior's table at dq_(k+1) (N x n); no columns: it has none
};

// The log's stretches of at least `shortest` [s]. What the prior says of the torque sensor and of motor
// inertia is taken out. Throws LogRefused: another number of joints, no commanded torque, no gravity.
std::vector<CommandedStretch> commanded_stretches(const MeasuredLog& log, const RobotDescription& prior,
                                                  double shortest);

double median_of(const Eigen::VectorXd& values);

}  // namespace multipanda
