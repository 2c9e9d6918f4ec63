#pragma once

#include <filesystem>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include <Eigen/Core>

// What one arm did, as numbers in SI units: the common ground of comparison and identification, wherever it
// was recorded. Rows are samples, N of them; n joints.
namespace multipanda {

struct MeasuredLog {
  std::string source;  // file it was read from
  std::string arm;     // name in the log; empty: the log has one arm and no name for it
  Eigen::VectorXd t;   // [s] (N), strictly increasing, as stamped
  // N x n, measured: joint positions [rad], velocities [rad/s], torque at the sensor, gravity included [N m].
  Eigen::MatrixXd q, dq, tau;
  // The following have no rows where the log does not tell.
  Eigen::MatrixXd tau_d;    // torque in use, without gravity (tau_J_d) [N m] (N x n)
  Eigen::MatrixXd tau_cmd;  // torque that the controllers asked for, without gravity [N m] (N x n)
  Eigen::MatrixXd gravity;  // of the arm's own model [N m] (N x n)
  Eigen::MatrixXd x_EE;     // position of the end effector in the world [m] (N x 3)
  Eigen::MatrixXd quat_EE;  // orientation in the world, w x y z (N x 4)
  Eigen::MatrixXd F_EE;     // estimated wrench, of the arm on its environment, world axes [N, N m] (N x 6)
  Eigen::MatrixXd F_true;   // the same as the simulation knows it (N x 6)
  std::string scene_text;   // scene of the run; empty: not told
  std::vector<std::string> warnings;  // what is odd about it and does not forbid its use, with the number

  Eigen::Index samples() const { return t.size(); }
  Eigen::Index joints() const { return q.cols(); }
  // Control error tau_d - (tau - gravity) [N m] (N x n); no rows where a part is missing.
  Eigen::MatrixXd control_error() const;
  double duration() const { return samples() > 1 ? t[samples() - 1] - t[0] : 0.0; }
};

// A log that cannot be used. what(): file, line or time, what was found, what was expected, what to do.
struct LogRefused : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct MeasuredLogOptions {
  // Of CSV files: our column name ("q1", "tau7", "t", ...) -> the file's. Empty: names are recognised.
  std::map<std::string, std::string> columns;
  std::string arm;  // only this one; empty: all
};

// Reads log.mcap (or the folder of a run that has one), CSV with columns t, q1.., dq1.., tau1.., or what the
// maker's library logs. One entry per arm. Throws LogRefused; std::invalid_argument if there is no such arm.
std::vector<MeasuredLog> read_measured(const std::filesystem::path& path,
                                       const MeasuredLogOptions& options = {});

// The checks that every use shares, done by read_measured: NaN, negative or falling time, gaps, units
// (degrees, milliseconds), velocities that are not the positions' slope. `refuse_above_gap_s`: a longer hole
// is refused, a shorter one a warning. Throws LogRefused; adds to log.warnings.
void check_measured(MeasuredLog& log, double refuse_above_gap_s = 0.1);

}  // namespace multipanda
