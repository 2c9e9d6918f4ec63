#include "cli/measured_arguments.hpp"

#include <cmath>
#include <filesystem>
#include <numbers>
#include <sstream>

#include <fmt/format.h>

namespace multipanda::cli {

void add_measured_arguments(CLI::App* command, MeasuredArguments& arguments) {
  option(command, "--arm", arguments.arm, "Arm to use if the log has several");
  option(command, "--columns", arguments.columns,
         "Names of CSV columns: OURS=THEIRS,... such as q1=joint_1,t=time, or a YAML file");
  command->add_flag("--hand", arguments.hand,
                    "The hand is mounted (default: as in the log's scene; without a scene not mounted)");
  command->add_flag("--no-hand", arguments.no_hand, "The hand is not mounted")->excludes("--hand");
  option(command, "--tool", arguments.tool,
         "Known body on the flange: mass [kg], center of mass [m] (default: as in the log's scene)",
         expecting(4), named("MASS X Y Z"));
  option(command, "--base", arguments.bases,
         "Base in the world as roll, pitch, yaw [rad], of all logs or of one; may be repeated (default: "
         "as in the log's scene or the CSV line '# base_rpy_rad: R P Y'; otherwise level)",
         named("[LOG=]R,P,Y"), expecting(1), repeated);
}

std::vector<MeasuredLog> read_one_arm(const std::string& given, const MeasuredArguments& arguments) {
  MeasuredLogOptions reading;
  reading.arm = arguments.arm;
  if (!arguments.columns.empty()) reading.columns = read_column_map(arguments.columns);
  std::vector<MeasuredLog> logs;
  for (const auto& path : find_repeats(given)) {
    std::vector<MeasuredLog> read = read_measured(path, reading);
    if (read.size() != 1) {
      throw UsageError(
          fmt::format("{} has {} arms; name the one to use with --arm", path.string(), read.size()));
    }
    logs.push_back(std::move(read.front()));
  }
  return logs;
}

namespace {

struct GivenBase {
  std::string log;  // empty: all
  Vector3 gravity_B;
  bool used = false;
};

GivenBase read_base(const std::string& text) {
  GivenBase base;
  const std::size_t equals = text.rfind('=');
  if (equals != std::string::npos) base.log = text.substr(0, equals);
  std::istringstream numbers(equals == std::string::npos ? text : text.substr(equals + 1));
  Vector3 rpy;
  std::vector<std::string> cells;
  for (std::string cell; std::getline(numbers, cell, ',');) cells.push_back(cell);
  bool good = cells.size() == 3 && equals != 0;
  for (std::size_t i = 0; good && i < 3; ++i) {
    double& value = rpy[static_cast<Eigen::Index>(i)];
    good = CLI::detail::lexical_cast(cells[i], value) && std::abs(value) <= 2 * std::numbers::pi;
  }
  if (!good) {
    throw UsageError(
        fmt::format("--base {}: expected LOG=ROLL,PITCH,YAW, or ROLL,PITCH,YAW for all logs, in radians (a "
                    "wall: 0,1.5708,0)",
                    text));
  }
  base.gravity_B = rotation_from_rpy(rpy).transpose() * Vector3(0, 0, -9.81);
  return base;
}

// A log is named by its path as given, or by its last part: file or run folder.
bool names(const std::string& given, const MeasuredLog& log) {
  namespace fs = std::filesystem;
  fs::path path(log.source);
  if (path.filename() == "log.mcap") path = path.parent_path();
  const fs::path name = fs::path(given).filename().empty() ? fs::path(given).parent_path() : fs::path(given);
  return name == path || name == fs::path(log.source) || name == path.filename();
}

}  // namespace

std::vector<Mounting> mount(std::vector<MeasuredLog>& logs, const MeasuredArguments& arguments,
                            bool with_load) {
  std::vector<GivenBase> bases;
  for (const std::string& text : arguments.bases) bases.push_back(read_base(text));
  std::vector<Mounting> mountings;
  std::string sources;
  for (MeasuredLog& log : logs) {
    Mounting mounting = mounting_of(log);
    if (arguments.hand) mounting.hand = true;
    if (arguments.no_hand) mounting.hand = false;
    if (!arguments.tool.empty()) {
      const double m = arguments.tool[0];
      mounting.tool = mounting.tool_without_load =
          RigidBody{m, Vector3(arguments.tool[1], arguments.tool[2], arguments.tool[3]),
                    1e-4 * m * Matrix3::Identity()};
    }
    for (const bool of_all : {true, false}) {  // the base of one log overrides that of all
      for (GivenBase& base : bases) {
        if (base.log.empty() != of_all || !(of_all || names(base.log, log))) continue;
        mounting.gravity_B = base.gravity_B;
        mounting.base_told = base.used = true;
      }
    }
    log.gravity_B = mounting.gravity_B;
    sources += (sources.empty() ? "" : ", ") + log.source;
    mountings.push_back(mounting);
  }
  for (const GivenBase& base : bases) {
    if (!base.used)
      throw UsageError(fmt::format("--base {}=...: no such log; expected one of {}", base.log, sources));
  }
  refuse_unlike(logs, mountings, with_load);
  return mountings;
}

}  // namespace multipanda::cli
