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
  std::vector<std::string> grippers;           // arms whose fingers are part of it
  std::map<std::string, std::string> leaders;  // by arm: the arm whose motion is its action
  std::vector<std::string> outcomes{"success"};
  unsigned fps = 30;  // frames per second
  std::string task;   // what was to be done; empty: the name of the first log's scene
};

struct LerobotResult {
  std::string said;                // what was made, human-readable
  std::vector<std::string> notes;  // what was left out, and why
};

// Makes a LeRobot data set of version 3.0 from the marked episodes of logs (docs/lerobot.md). The folder must
// not exist yet, and exists only once it is complete.
//
// Runs report/export_lerobot.py. Needs as much space beside the folder as the logs have numbers. Off the loop
// only. Throws std::runtime_error with the reason and what to do.
LerobotResult export_lerobot(const std::vector<std::filesystem::path>& logs,
                             const std::filesystem::path& folder, const LerobotOptions& options);

}  // namespace multipanda
