#pragma once

#include <filesystem>
#include <map>
#include <string>

#include <nlohmann/json.hpp>

#include "experiments/experiment.hpp"
#include "experiments/kinds.hpp"
#include "scene/load.hpp"

namespace multipanda {

// One run of a task: one repeat of a variant on a plant.
struct TaskRun {
  const ExperimentVariant* variant = nullptr;
  std::string plant;
  std::size_t repeat = 0;  // from 1
  std::string name() const { return plant + "_" + variant->name + "_" + std::to_string(repeat); }
};

// Variants by name or tag, in the experiment's order. All variants if `only` is empty. Throws
// std::invalid_argument with the nearest name.
std::vector<const ExperimentVariant*> chosen_variants(const Experiment& experiment,
                                                      const std::vector<std::string>& only);

// All runs in order: repeats within a variant, plants within a repeat, so that compared runs are adjacent.
std::vector<TaskRun> task_runs(const Experiment& experiment, std::size_t repeats,
                               const std::vector<std::string>& only);

// The scene of a run as text: the scene file with the values of the experiment and the variant, the
// plant, and the variation of the repeat. A repeat varies in the same way in every variant and on every
// plant. Throws ConfigError.
std::string task_scene_text(const Experiment& experiment, const TaskRun& run);

// The timeline of such a scene, for the page: [{"at_s": 3, "what": "motion"}, ...].
nlohmann::ordered_json timeline_of(const std::string& scene_text);

// The checked scene of a run. `registry` must have the controllets of the scene's plug-ins.
Scene task_scene(const Experiment& experiment, const TaskRun& run, const Registry& registry);

// Everything that determines the runs of an experiment besides their `scenes` (texts of all of them): the
// experiment without keys that only affect its page, the backend and the addresses.
nlohmann::ordered_json what_decides(const Experiment& experiment, const ExperimentOptions& options,
                                    const std::string& scenes);

// The finished runs of an experiment, kept in its folder so that an interrupted experiment can be resumed.
// One thread at a time.
class FinishedRuns {
 public:
  // `what`: from what_decides(). `resume`: continues with the finished runs; otherwise starts from scratch.
  // Throws std::invalid_argument if the folder has nothing to resume, or was begun with a different `what`;
  // the message names the first key that differs.
  FinishedRuns(std::filesystem::path folder, nlohmann::ordered_json what, bool resume);

  const nlohmann::ordered_json* find(const std::string& run) const;  // nullptr: not finished
  void add(const std::string& run, const nlohmann::ordered_json& record);
  void remove_file() const;  // once the page exists, nothing is left to resume
  std::size_t count() const { return runs_.size(); }

 private:
  std::filesystem::path file_;
  nlohmann::ordered_json what_;
  std::map<std::string, nlohmann::ordered_json> runs_;
};

}  // namespace multipanda
