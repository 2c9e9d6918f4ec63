#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "backends/arm/arm_error.hpp"

namespace multipanda {

// Why an arm stopped itself, as far as the records tell.
struct ErrorExplanation {
  ReflexDetail detail;  // of the first error with a number, limits before contacts; count_: none has one
  std::vector<std::string> sentences;  // per error: what happened, which joint or axis, value and limit
  std::vector<std::string> cures;      // what to do next, per error
  // Of the periods in these records, as seen by this computer: share that was answered, and the most in a
  // row that were not.
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
  std::filesystem::path file;  // the last cycles as a table; empty: could not be written
  std::string file_problem;    // why not

  std::string headline() const;            // "arm 'left' stopped itself at 2.500 s: joint_reflex"
  std::vector<std::string> lines() const;  // all of it, for people
};

}  // namespace multipanda
