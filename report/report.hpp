#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "core/controllets/controllet.hpp"

namespace multipanda {

struct ReportOptions {
  std::filesystem::path directory;  // for the page and its plots; empty: next to the log
  bool pictures = true;             // of the scene, rebuilt from the log
  std::size_t max_pictures = 4;     // at the start, at switches, in the middle, at the end
  bool keep_data = false;           // keep the data files of the page: report_data.npz, .json
  // Types that the scene may name beyond the built-in ones and the plug-ins'.
  std::vector<ControlletType> controllets;
  // Additions to the log's description of the run, such as the thread set-up.
  std::map<std::string, std::string> info;
};

struct ReportResult {
  std::filesystem::path page;                   // DIRECTORY/report.html
  std::vector<std::filesystem::path> pictures;  // of the scene
  bool repaired = false;                        // the missing footer of the log was added
  std::vector<std::string> notes;               // what is missing or failed, also shown on the page
};

// Makes the report of one run: a self-contained page, and its plots. `log_or_directory` is a log or the
// folder of a run with its log.mcap. A log without a footer is repaired first. If that fails, or the log
// still seems to be written, the report covers its complete part.
//
// Runs report/report.py (see PageScript). Takes seconds; off the loop only. On SIGINT, SIGTERM and SIGHUP it
// removes its data files and ends the program. Throws std::runtime_error with the reason and the remedy.
ReportResult make_report(const std::filesystem::path& log_or_directory, const ReportOptions& options = {});

struct LerobotOptions {
  std::vector<std::string> arms;               // in the order of the features; empty: all of the first log
  std::string action;                          // joints or pose; empty: the first one that the logs have
  std::vector<std::string> observe{"joints"};  // joints, velocities, torques, pose, wrench
  std::vector<std::string> grippers;           // arms whose fingers are included
  std::map<std::string, std::string> leaders;  // by arm: the arm whose motion is recorded as its action
  std::vector<std::string> outcomes{"success"};
  unsigned fps = 30;  // frames per second
  std::string task;   // task description; empty: the scene name of the first log
};

struct LerobotResult {
  std::string said;                // summary of the result
  std::vector<std::string> notes;  // what was left out, and why
};

// Makes a LeRobot data set of version 3.0 from the marked episodes of logs (docs/lerobot.md). The folder must
// not exist; it appears when complete.
//
// Runs report/export_lerobot.py. Needs disk space of the size of the exported arrays next to the folder. Off
// the loop only. Throws std::runtime_error with the reason and the remedy.
LerobotResult export_lerobot(const std::vector<std::filesystem::path>& logs,
                             const std::filesystem::path& folder, const LerobotOptions& options);

}  // namespace multipanda
