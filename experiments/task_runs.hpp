#pragma once

#include "experiments/experiment.hpp"
#include "scene/load.hpp"

namespace multipanda {

// One run of a task: a variant on a plant, for the so-many-th time.
struct TaskRun {
  const ExperimentVariant* variant = nullptr;
  std::string plant;
  std::size_t repeat = 0;  // from 1
  std::string name() const { return plant + "_" + variant->name + "_" + std::to_string(repeat); }
};

// Variants by name or tag, in the experiment's order; empty `only`: all. Throws std::invalid_argument with
// the nearest name.
std::vector<const ExperimentVariant*> chosen_variants(const Experiment& experiment,
                                                      const std::vector<std::string>& only);

// Repeats one after the other within a variant, plants within a repeat: what is compared stands together.
std::vector<TaskRun> task_runs(const Experiment& experiment, std::size_t repeats,
                               const std::vector<std::string>& only);

// The scene of a run as text: the scene file with the experiment's values, the variant's, the plant, and the
// repeat's variation. The same repeat is varied alike in every variant and on every plant. Throws SceneError.
std::string task_scene_text(const Experiment& experiment, const TaskRun& run);

// What happens by itself in such a scene, for the page: [{"at_s": 3, "what": "motion"}, ...].
nlohmann::ordered_json timeline_of(const std::string& scene_text);

// Read and checked. `registry` must have the controllets of the scene's plugins.
Scene task_scene(const Experiment& experiment, const TaskRun& run, const Registry& registry);

}  // namespace multipanda
