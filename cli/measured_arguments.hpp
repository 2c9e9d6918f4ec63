#pragma once

#include <string>
#include <vector>

#include "cli/program.hpp"
#include "sysid/identification/identify.hpp"

namespace multipanda::cli {

// Shared by `identify` and `predict`: reading logs, and the equipment on the flange.
struct MeasuredArguments {
  std::string arm, columns;
  std::vector<double> tool;        // mass [kg], center of mass [m] (4), or empty
  std::vector<std::string> bases;  // ROLL,PITCH,YAW [rad] of all logs, or LOG=ROLL,PITCH,YAW of one
  bool hand = false, no_hand = false;
};

void add_measured_arguments(CLI::App* command, MeasuredArguments& arguments);

// The logs of one arm in a file, a log or a folder of runs. Throws UsageError if several arms are in it.
std::vector<MeasuredLog> read_one_arm(const std::string& given, const MeasuredArguments& arguments);

// Hand, tool and base of each log: from the arguments, otherwise from the log (scene, CSV header), otherwise
// a bare flange on a level base. Sets the logs' gravity_B. Throws UsageError for a base of no log, and
// LogRefused for logs that cannot be combined (refuse_unlike).
std::vector<Mounting> mount(std::vector<MeasuredLog>& logs, const MeasuredArguments& arguments,
                            bool with_load);

}  // namespace multipanda::cli
