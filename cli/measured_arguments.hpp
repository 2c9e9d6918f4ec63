#pragma once

#include <string>
#include <vector>

#include "cli/program.hpp"
#include "sysid/identification/mounting.hpp"

namespace multipanda::cli {

// What `identify` and `predict` have in common: how logs are read, and what is mounted on the flange.
struct MeasuredArguments {
  std::string arm, columns;
  std::vector<double> tool;  // mass [kg], center of mass [m] (4), or empty
  bool hand = false, no_hand = false;
};

void add_measured_arguments(CLI::App* command, MeasuredArguments& arguments);

// The logs of one arm in a file, a log or a folder of runs. Throws UsageError if several arms are in it.
std::vector<MeasuredLog> read_one_arm(const std::string& given, const MeasuredArguments& arguments);

// Hand and tool: from the arguments, otherwise from the log's scene, otherwise none.
Mounting mounting_of(const MeasuredLog& log, const MeasuredArguments& arguments);

}  // namespace multipanda::cli
