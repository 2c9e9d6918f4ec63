#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "experiments/experiment.hpp"
#include "scene/load.hpp"

// One run of a study: a scene with changes, as fast as possible, in this process. Many in a row share the
// process, which otherwise takes longer to start than a short run to run.
namespace multipanda {

struct SceneRun {
  std::string scene;  // path
  std::vector<Override> set;
  std::vector<Variation> vary;  // by the seed
  std::uint64_t seed = 1;
  std::optional<double> seconds;
  bool hidden = false;
  std::filesystem::path log;  // file; empty: none
};

// From a line of `multipanda study --worker`. Throws std::invalid_argument.
SceneRun scene_run_from(const nlohmann::ordered_json& json);

// Throws std::invalid_argument (ConfigError) if the run would be refused.
void check_scene_run(const SceneRun& run);
// Plug-ins and model files that the scene names, with the files that those name.
std::vector<std::string> scene_files(const SceneRun& run);

// {"figures": {...}, "success": ..., "faults": [...], "cost": {...}}: docs/studies.md. The figures depend on
// the run alone; `cost` has the times that it took [s]. Throws std::invalid_argument (refused) or
// std::runtime_error.
nlohmann::ordered_json run_scene(const SceneRun& run);

}  // namespace multipanda
