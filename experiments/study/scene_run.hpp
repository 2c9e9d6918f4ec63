#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "core/record/cycle_record.hpp"
#include "experiments/experiment.hpp"
#include "scene/load.hpp"

namespace multipanda {

// Figures of one run from all of its cycles (docs/studies.md). Relay thread, every record in order.
class RunFigures {
 public:
  explicit RunFigures(const RecordLayout& layout) : layout_(layout), arms_(layout.arms.size()) {
    for (const auto& instance : layout.instances) outputs_.emplace_back(instance.outputs.size());
  }

  void take(const CycleRecord& record);
  nlohmann::ordered_json json() const;

 private:
  struct Arm {
    double speed = 0, torque = 0, torque_squares = 0, force = 0, force_sum = 0, estimate = 0;
    bool has_force = false, has_estimate = false;
    std::uint64_t interventions = 0;
    std::vector<double> q;
  };
  struct Output {  // a scalar, over the cycles in which its controllet is active
    std::uint64_t cycles = 0;
    double low = 0, high = 0, last = 0;
  };
  void take_arm(const ArmSample& sample, std::size_t joints, Arm& arm);
  void digest(const double* values, std::size_t count);

  const RecordLayout layout_;
  std::vector<Arm> arms_;
  std::vector<std::vector<Output>> outputs_;  // [instance][output]
  std::uint64_t cycles_ = 0;
  double t_s_ = 0;
  std::uint64_t digest_ = 0xcbf29ce484222325ULL;  // FNV-1a, 64 bits
};

// One run of a study: a scene with changes, as fast as possible. Many runs share one process, because
// starting it takes longer than a short run.

struct SceneRun {
  std::string scene;  // path
  std::vector<Override> set;
  std::vector<Variation> vary;  // drawn from the seed
  std::uint64_t seed = 1;
  std::optional<double> seconds;
  bool hidden = false;
  std::filesystem::path log;  // file; empty: none
};

// From a line of `multipanda study --worker`. Throws std::invalid_argument.
SceneRun scene_run_from(const nlohmann::ordered_json& json);

// Throws std::invalid_argument (ConfigError) if the run would be refused.
void check_scene_run(const SceneRun& run);
// Plug-ins and model files of the scene, and the files that those depend on.
std::vector<std::string> scene_files(const SceneRun& run);

// {"figures": {...}, "success": ..., "faults": [...], "cost": {...}}: docs/studies.md. `figures` are
// reproducible; `cost` has computing times [s]. Throws std::invalid_argument (refused) or std::runtime_error.
nlohmann::ordered_json run_scene(const SceneRun& run);

}  // namespace multipanda
