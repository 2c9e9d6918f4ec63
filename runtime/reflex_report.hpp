#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "device/arm_error.hpp"

namespace multipanda {

// Why an arm stopped itself, according to the records.
struct ErrorExplanation {
  ReflexDetail detail;  // of the first error with a number, limits before contacts; count_: no number
  std::vector<std::string> sentences;  // per error: event, joint or axis, value and limit
  std::vector<std::string> cures;      // what to do next, per error
  // Periods in these records, as seen by this computer: number, answered share, longest run of misses.
  std::size_t cycles = 0;
  double answered = 0;
  std::uint64_t missed_in_row = 0;
};

// An arm stopped itself in a run.
struct ReflexReport {
  std::string arm;
  double t_s = 0;  // loop time
  std::uint64_t cycle = 0;
  std::uint64_t errors = 0;  // bit i: ArmError i
  ErrorExplanation why;
  std::filesystem::path file;  // table of the last cycles; empty: not written
  std::string file_problem;    // why not

  std::string reason() const;              // "joint_reflex: joint 4 ..."
  std::string headline() const;            // "arm 'left' stopped itself at 2.500 s: joint_reflex"
  std::vector<std::string> lines() const;  // the whole report, human-readable
};

}  // namespace multipanda
