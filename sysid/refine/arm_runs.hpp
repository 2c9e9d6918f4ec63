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
  // Adds properties that no identified model can express: elastic joints (10,000 N m/rad on average) measured
  // at their motors, gear ripple (0.2 N m), and half of the rotors' inertia.
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
  std::filesystem::path logs;     // existing folder for NAME.mcap
  std::size_t workers = 2;        // parallel runs; real arms: one
  const std::atomic<bool>* stop = nullptr;
};

struct ArmRunResult {
  std::string name;
  std::filesystem::path log;
  std::vector<std::string> faults;  // failures; empty: none
  double time_s = 0, elapsed_s = 0;
};

// Executes all runs, in any order and in parallel; results are in the order of `runs`. Calls `finished` after
// each run, never concurrently. If stopped, there are fewer results than runs. Rethrows the exception of the
// first failed run.
std::vector<ArmRunResult> run_all(const std::vector<ArmRun>& runs, const RunSettings& settings,
                                  const std::function<void(const ArmRunResult&)>& finished = {});

}  // namespace multipanda
