#pragma once

#include <vector>

#include <Eigen/Core>

#include "models/robot_description.hpp"
#include "sysid/measured/measured_log.hpp"

namespace multipanda {

// Rows of one log without a gap: the commands and the values that they are compared with.
struct CommandedStretch {
  double period = 0.001;     // [s]
  Eigen::MatrixXd command;   // (N x n)
  Eigen::MatrixXd beyond;    // tau_J[k+1] - g(q_k) + I_m ddq: tracking less friction (N x n)
  Eigen::MatrixXd q;         // (N x n)
  Eigen::MatrixXd ddq;       // mean over 3 periods [rad/s^2] (N x n)
  Eigen::MatrixXd friction;  // of the prior's table at dq_(k+1) (N x n); no columns: the prior has no table
};

// The log's stretches of at least `shortest` [s]. The prior's sensor gains, sensor offsets and motor inertia
// are subtracted. Throws LogRefused for another number of joints, and without commanded torque or gravity.
std::vector<CommandedStretch> commanded_stretches(const MeasuredLog& log, const RobotDescription& prior,
                                                  double shortest);

double median_of(const Eigen::VectorXd& values);

}  // namespace multipanda
