#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace multipanda {

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
