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
  std::string scene_path;   // where it was read from: relative paths in it start there
  std::vector<std::size_t> lines;     // of a CSV file: the line of each sample; else empty
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

// Of CSV files: our name of a column -> the file's. Our names: t, and for joint k from 1 qk, dqk, tauk,
// tau_dk, tau_cmdk, gravityk; x_EE1..3, quat_EE1..4, F_EE1..6. A whole family in one entry: "q" ->
// "position_{}"
// ({}: counted from 1, {0}: from 0). The file's name may be followed by a factor: "time_ms * 0.001".
using ColumnMap = std::map<std::string, std::string>;

struct MeasuredLogOptions {
  ColumnMap columns;                // empty: names are recognised
  std::string arm;                  // only this one; empty: all
  bool needs_dynamics = true;       // without dq or tau it is refused; false: they may have no rows
  double refuse_above_gap_s = 0.1;  // see check_measured
};

// Reads log.mcap (or the folder of a run that has one), CSV with columns t, q1.., dq1.., tau1.., the tables
// of `export --csv`, or what the maker's library logs (franka::logToCSV). One entry per arm. Of MCAP logs
// x_EE, quat_EE and gravity are computed at every sample, from the scene in the log. Throws LogRefused;
// std::invalid_argument if there is no such arm.
std::vector<MeasuredLog> read_measured(const std::filesystem::path& path,
                                       const MeasuredLogOptions& options = {});

// Reads "FILE.yaml" (a mapping of names) or "q1=joint_1,t=time". Throws LogRefused with file and line.
ColumnMap read_column_map(const std::string& file_or_pairs);

// The repeats behind a path: itself if it is a log or a run's folder, else the logs in it and the runs'
// folders in it, in the order of their names with numbers counted (run_2 before run_10). Throws LogRefused if
// there is none.
std::vector<std::filesystem::path> find_repeats(const std::filesystem::path& path);

// The checks that every use shares, done by read_measured: NaN, negative or falling time, gaps, units
// (degrees, milliseconds), velocities that are not the positions' slope, values that stand still. Stretches
// of more than `refuse_above_gap_s` without news are refused, shorter ones a warning. Throws LogRefused; adds
// to log.warnings; samples stamped twice are left out.
void check_measured(MeasuredLog& log, double refuse_above_gap_s = 0.1);

// Whether the log can be of this robot: number of joints, ranges, velocities, torques (n x 1 each; an empty
// one is not checked). Throws LogRefused naming the joint; adds to log.warnings.
struct RobotRanges {
  std::string robot;
  Eigen::VectorXd q_min, q_max, dq_max, tau_max;
};
void check_robot(MeasuredLog& log, const RobotRanges& ranges);

// Fills what a log lacks of x_EE, quat_EE and gravity from the model that the scene's arm `arm` has, its tool
// and its declared load. `arm` empty: the scene's only one. Throws std::invalid_argument without such an arm,
// with another number of joints, or if the scene cannot be rebuilt here.
void complete_from_scene(MeasuredLog& log, const std::string& scene_text, const std::string& scene_path,
                         const std::string& arm);

}  // namespace multipanda
