#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include <Eigen/Core>

// The recorded motion of one arm, as numbers in SI units: the common input of comparison and identification,
// whatever the log's source. Rows are samples, N of them; n joints.
namespace multipanda {

struct MeasuredLog {
  std::string source;  // file it was read from
  std::string arm;     // name in the log; empty: the log has one unnamed arm
  Eigen::VectorXd t;   // [s] (N), strictly increasing, as stamped
  // N x n, measured: joint positions [rad], velocities [rad/s], torque at the sensor, gravity included [N m].
  Eigen::MatrixXd q, dq, tau;
  // The following have no rows if the log lacks them.
  Eigen::MatrixXd tau_d;    // torque in use, without gravity (tau_J_d) [N m] (N x n)
  Eigen::MatrixXd tau_cmd;  // torque requested by the controllers, without gravity [N m] (N x n)
  Eigen::MatrixXd gravity;  // of the arm's own model [N m] (N x n)
  Eigen::MatrixXd tau_ext;  // external torque as the arm estimates it, tau_J - model [N m] (N x n)
  Eigen::MatrixXd contact;  // 1 while something is known to touch the arm, otherwise 0 (N x 1)
  Eigen::MatrixXd x_EE;     // position of the end effector in the world [m] (N x 3)
  Eigen::MatrixXd quat_EE;  // orientation in the world, w x y z (N x 4)
  Eigen::MatrixXd F_EE;     // estimated wrench of the arm on its environment, F_K_W [N, N m] (N x 6)
  Eigen::MatrixXd F_true;   // the same from the simulation's contacts (N x 6)
  // Gravity in the arm's base [m/s^2], which gives its mounting; none: unknown.
  std::optional<Eigen::Vector3d> gravity_B;
  std::string scene_text;             // scene of the run; empty: unknown
  bool base_moves = false;            // an arm of the scene stands on another one: no pose, no gravity
  std::string scene_path;             // path of the scene; relative paths in the scene start at its folder
  std::vector<std::size_t> lines;     // of a CSV file: the line of each sample; otherwise empty
  std::vector<std::string> warnings;  // unusual findings that do not prevent use, with numbers

  Eigen::Index samples() const { return t.size(); }
  Eigen::Index joints() const { return q.cols(); }
  // Control error tau_d - (tau - gravity) [N m] (N x n); no rows if a part is missing.
  Eigen::MatrixXd control_error() const;
  double duration() const { return samples() > 1 ? t[samples() - 1] - t[0] : 0.0; }
  double period() const;  // median step of the stamps, 0 without [s]
};

// A log that cannot be used. what() has file, line or time, what was found, what was expected and what to do.
struct LogRefused : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Names of CSV columns: our name -> the file's. Our names are t and, for joint k from 1, qk, dqk, tauk,
// tau_dk, tau_cmdk, gravityk, tau_extk; also x_EE1..3, quat_EE1..4, F_EE1..6, contact. One entry can name a
// family: "q" -> "position_{}" ({} counts from 1, {0} from 0). A factor may follow the file's name:
// "time_ms * 0.001".
using ColumnMap = std::map<std::string, std::string>;

struct MeasuredLogOptions {
  ColumnMap columns;                // empty: the reader recognizes the names
  std::string arm;                  // only this one; empty: all
  bool needs_dynamics = true;       // refuses a log without dq or tau; false: they may have no rows
  double refuse_above_gap_s = 0.1;  // see check_measured
};

// Reads log.mcap (or the folder of a run that has one), CSV with columns t, q1.., dq1.., tau1.., tables of
// `export --csv`, CSV of libfranka (franka::logToCSV), archives of numpy, and bags of ROS (read_others). A
// line "# base_rpy_rad: R P Y" before the names of a CSV file gives the base in the world. One entry per arm.
// For our logs x_EE, quat_EE and gravity are computed at every sample from the scene in the log. Throws
// LogRefused, and std::invalid_argument for an unknown arm.
std::vector<MeasuredLog> read_measured(const std::filesystem::path& path,
                                       const MeasuredLogOptions& options = {});

// Reads "FILE.yaml" (a mapping of names) or "q1=joint_1,t=time". Throws LogRefused with file and line.
ColumnMap read_column_map(const std::string& file_or_pairs);

// The repeats at a path: the path itself if it is a log, a bag or a run's folder, otherwise those in it, in
// natural order (run_2 before run_10). Throws LogRefused if there are none.
std::vector<std::filesystem::path> find_repeats(const std::filesystem::path& path);

// The checks for every use, done by read_measured: NaN, negative or decreasing time, gaps, units (degrees,
// milliseconds), velocities that differ from the slope of the positions, frozen values. Stretches without new
// data are refused above `refuse_above_gap_s` and give a warning below it. Samples with repeated stamps are
// left out. Adds to log.warnings. Throws LogRefused.
void check_measured(MeasuredLog& log, double refuse_above_gap_s = 0.1);

// Checks that the log can come from this robot: number of joints, ranges, velocities, torques (n x 1 each; an
// empty one is not checked). Adds to log.warnings. Throws LogRefused naming the joint.
struct RobotRanges {
  std::string robot;
  Eigen::VectorXd q_min, q_max, dq_max, tau_max;
};
void check_robot(MeasuredLog& log, const RobotRanges& ranges);

// Computes x_EE, quat_EE and gravity if a log lacks them, from the model, tool and declared load of the
// scene's arm `arm`; empty: the scene's only arm. Throws std::invalid_argument for an unknown arm, another
// number of joints, or a scene that cannot be rebuilt.
void complete_from_scene(MeasuredLog& log, const std::string& scene_text, const std::string& scene_path,
                         const std::string& arm);

// One arm from a CSV file, unchecked. Throws LogRefused.
MeasuredLog read_csv(const std::filesystem::path& path, const MeasuredLogOptions& options);

// All arms of a recording that sysid/measured/others.py turns into tables, unchecked: .npz, .npy, bags of ROS
// 1 and 2. Takes a second more than other files. Throws LogRefused.
std::vector<MeasuredLog> read_others(const std::filesystem::path& path, const MeasuredLogOptions& options);

// Whether a file is a log of multipanda, also of a killed run. Opens it.
bool is_own_log(const std::filesystem::path& path);

// Writes logs of any source (of several arms, if they are of one recording) as one of our logs, for reports,
// replays and exports. Throws std::runtime_error if the file cannot be written.
void write_own_log(std::span<const MeasuredLog> logs, const std::filesystem::path& path);

// All arms (or options.arm) of one of our logs, unchecked, completed from the scene in it. Throws LogRefused,
// and std::invalid_argument for an unknown arm.
std::vector<MeasuredLog> read_mcap(const std::filesystem::path& path, const MeasuredLogOptions& options);

}  // namespace multipanda
