#include "cli/measured_arguments.hpp"

#include <fmt/format.h>

namespace multipanda::cli {

void add_measured_arguments(CLI::App* command, MeasuredArguments& arguments) {
  command->add_option("--arm", arguments.arm, "Arm to use if the log has several");
  command->add_option("--columns", arguments.columns,
                      "Names of CSV columns: OURS=THEIRS,... such as q1=joint_1,t=time, or a YAML file");
  command->add_flag("--hand", arguments.hand,
                    "The hand is mounted (default: as in the log's scene; without a scene not mounted)");
  command->add_flag("--no-hand", arguments.no_hand, "The hand is not mounted")->excludes("--hand");
  command
      ->add_option("--tool", arguments.tool,
                   "Known body on the flange: mass [kg], center of mass [m] (default: as in the log's scene)")
      ->expected(4)
      ->type_name("MASS X Y Z");
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

Mounting mounting_of(const MeasuredLog& log, const MeasuredArguments& arguments) {
  Mounting mounting = mounting_of(log);
  if (arguments.hand) mounting.hand = true;
  if (arguments.no_hand) mounting.hand = false;
  if (!arguments.tool.empty()) {
    const double m = arguments.tool[0];
    mounting.tool = mounting.tool_without_load = RigidBody{
        m, Vector3(arguments.tool[1], arguments.tool[2], arguments.tool[3]), 1e-4 * m * Matrix3::Identity()};
  }
  return mounting;
}

}  // namespace multipanda::cli
