#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/modes/registry.hpp"

namespace multipanda {

// Whose arms are to be copied. What comes back from them are logs and nothing else.
struct RefineTarget {
  std::optional<std::uint64_t> hidden;  // virtual arms of another process, drawn from this seed
  std::vector<std::pair<std::string, std::string>> addresses;  // else real arms: name, address
  // Else virtual arms of this process, whose models are in these files (arm -> file): for tests.
  std::map<std::string, std::string> known;

  std::string words() const;  // "hidden plants, seed 3"
};

// One run of a scene.
struct ArmRun {
  std::string name;        // of the log
  std::string scene;       // text; relative paths in it start at RunSettings::scene_path's folder
  bool on_target = false;  // else in simulation
};

struct RunSettings {
  RefineTarget target;
  std::string scene_path;
  std::filesystem::path program;  // multipanda itself, for hidden plants
  std::filesystem::path logs;     // folder that gets NAME.mcap; must exist
  std::size_t workers = 2;        // runs at once; real arms: one, in real time
  const std::atomic<bool>* stop = nullptr;
};

struct ArmRunResult {
  std::string name;
  std::filesystem::path log;
  std::vector<std::string> faults;  // what went wrong in it; empty: nothing
  double time_s = 0, elapsed_s = 0;
};

// Runs them all, in any order, several at once; results in the order of `runs`. `finished` is called after
// each, one at a time. Stopped: fewer results than runs. Throws what the first failed run threw.
std::vector<ArmRunResult> run_all(const std::vector<ArmRun>& runs, const RunSettings& settings,
                                  const std::function<void(const ArmRunResult&)>& finished = {});

}  // namespace multipanda
