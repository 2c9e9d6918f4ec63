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

// The arms to be modeled. They return only logs.
struct RefineTarget {
  std::optional<std::uint64_t> hidden;  // virtual arms of another process, drawn from this seed
  // They have what no identified model can express: joints are elastic (10,000 N m/rad on average) and
  // measured at their motors, gears ripple (0.2 N m); and half of the rotors' inertia acts.
  bool motors = false;
  std::vector<std::pair<std::string, std::string>> addresses;  // otherwise real arms: name, address
  // Otherwise virtual arms of this process, whose models are in these files (arm -> file): for tests.
  std::map<std::string, std::string> known;

  std::string words() const;  // human-readable: "hidden plants of seed 3"
};

// One run of a scene.
struct ArmRun {
  std::string name;        // of the log
  std::string scene;       // text; relative paths in it start at RunSettings::scene_path's folder
  bool on_target = false;  // otherwise in simulation
};

struct RunSettings {
  RefineTarget target;
  std::string scene_path;
  std::filesystem::path program;  // multipanda itself, for hidden plants
  std::filesystem::path logs;     // folder that gets NAME.mcap; must exist
  std::size_t workers = 2;        // runs at once; real arms: one
  const std::atomic<bool>* stop = nullptr;
};

struct ArmRunResult {
  std::string name;
  std::filesystem::path log;
  std::vector<std::string> faults;  // what went wrong; empty: nothing
  double time_s = 0, elapsed_s = 0;
};

// Executes all runs, in any order, several at once; results are in the order of `runs`. Calls
// `finished` after each, one at a time. If stopped, there are fewer results than runs. Rethrows the exception
// of the first failed run.
std::vector<ArmRunResult> run_all(const std::vector<ArmRun>& runs, const RunSettings& settings,
                                  const std::function<void(const ArmRunResult&)>& finished = {});

}  // namespace multipanda
