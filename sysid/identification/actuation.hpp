#pragma once

#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "core/types/joints.hpp"
#include "models/robot_description.hpp"
#include "sysid/measured/measured_log.hpp"

// How an arm turns commanded torque into torque at its joints, from logs that hold both: delay, bandwidth,
// friction between motor and torque sensor, sensor noise. For each joint and period of the control interface
// (docs/simulation.md):
//   u_k = (1 - f) tau_cmd[k-D] + f tau_cmd[k-D-1]        delay of D + f periods: mean of the held command
//   x_k = x_(k-1) + (1 - exp(-2 pi bandwidth dt)) (u_k - x_(k-1))                first-order tracking
//   tau_J[k+1] = x_k + g(q_k) - scale tau_f(dq_(k+1)) - I_m ddq + offset + noise
// g is that of the log: the arm's model according to its scene; tau_f from the prior's sigmoid table. I_m is
// the prior's motor inertia; if it has none, what motors add is estimated for each joint and kept only where
// it predicts left-out sixths of the data better. Masses, payload and contact do not occur, because the links
// are behind the sensor.
namespace multipanda {

struct ActuationOptions {
  double longest_delay = 0.010;                          // [s]
  double lowest_bandwidth = 5, highest_bandwidth = 500;  // [Hz]; above: perfect
  // Unused start of every unbroken stretch, where earlier commands are unknown [s].
  double settle = 0.1;
};

// Results. The true value lies within value +- half95 with a probability of 95 %.
struct ActuationFit {
  Actuation actuation;
  double delay_half95 = 0, bandwidth_half95 = 0;  // [s, Hz]; bandwidth 0 (perfect): 0
  JointVector friction_scale,
      friction_scale_half95;  // of the prior's table (n x 1); empty: the prior has no table
  JointVector offset;         // of the torque sensor [N m] (n x 1)
  JointVector motor_inertia;  // in addition to the prior's [kg m^2] (n x 1), 0: no gain; empty: in no joint
  double noise = 0;           // of the torque sensor, white [N m]
  JointVector rms;            // residual [N m] (n x 1)
  std::size_t samples = 0;    // rows used
  std::vector<std::string> warnings;
};

// Least squares over all logs: a grid over delay and bandwidth with everything else in closed form, then
// Gauss-Newton. The intervals allow for residuals that are correlated over up to 0.1 s. Any thread; 10 s of
// data take about a second, with motors that act up to six. Throws LogRefused if there is no commanded
// torque, no gravity from the arm's own model, no stretch of 0.2 s without a gap, or if the torque does not
// follow the commands.
ActuationFit fit_actuation(std::span<const MeasuredLog> logs, const RobotDescription& prior,
                           const ActuationOptions& options = {});

// Writes the fit into the robot: actuation, friction table, noise of the
// torque sensor, and the motor inertia if it was found.
void apply(const ActuationFit& fit, RobotDescription& robot);

// Torque x that the motors produce from the commands, per row k as above (N x n); `tau_cmd` has no gaps.
Eigen::MatrixXd tracked_torque(const Eigen::MatrixXd& tau_cmd, const Actuation& actuation, double period);

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
