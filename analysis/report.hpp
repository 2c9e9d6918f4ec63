#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "core/controllets/controllet.hpp"

namespace multipanda {

struct ReportOptions {
  std::filesystem::path directory;          // for the page and its plots; empty: beside the log
  bool pictures = true;                     // of the scene, rebuilt from the log
  std::size_t max_pictures = 4;             // at the start, at switches, in the middle, at the end
  bool keep_data = false;                   // leave what the page was made from: report_data.npz, .json
  std::vector<ControlletType> controllets;  // that the scene may name beyond multipanda's and the plugins'
  std::map<std::string, std::string> info;  // beyond what the log says of the run, such as the thread set-up
};

struct ReportResult {
  std::filesystem::path page;                   // DIRECTORY/report.html
  std::vector<std::filesystem::path> pictures;  // of the scene
  bool repaired = false;                        // the log had no footer and got one
  std::vector<std::string> notes;               // what is missing or went wrong, also on the page; for people
};

// Makes the report of one run: a page that needs nothing else, and its plots. `log_or_directory` is a log or
// the folder of a run with its log.mcap. A log without a footer is repaired first; where that fails, or
// somebody seems to be writing it still, what is whole in it is reported.
//
// Runs analysis/report.py of the folder in the environment variable MULTIPANDA_SHARE, else of the project,
// with the interpreter in MULTIPANDA_PYTHON, else that of the project's Python environment. Takes seconds;
// off the loop only. Throws std::runtime_error saying why and what to do when there is no report.
ReportResult make_report(const std::filesystem::path& log_or_directory, const ReportOptions& options = {});

}  // namespace multipanda
