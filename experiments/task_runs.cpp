#include "experiments/task_runs.hpp"

#include <algorithm>
#include <fstream>
#include <sstream>

#include "experiments/on_arms.hpp"
#include "experiments/seeded_draw.hpp"
#include "experiments/yaml_tree.hpp"
#include "scene/carried_arms.hpp"
#include "support/spelling.hpp"

namespace multipanda {
namespace {

std::string read_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  if (!in) throw ConfigError({path, 0}, "cannot be read");
  return text.str();
}

}  // namespace

std::vector<const ExperimentVariant*> chosen_variants(const Experiment& experiment,
                                                      const std::vector<std::string>& only) {
  std::vector<const ExperimentVariant*> chosen;
  std::vector<std::string> known;
  for (const auto& variant : experiment.variants) {
    known.insert(known.end(), variant.tags.begin(), variant.tags.end());
    const bool requested =
        only.empty() || std::any_of(only.begin(), only.end(), [&](const auto& name) {
          return std::find(variant.tags.begin(), variant.tags.end(), name) != variant.tags.end();
        });
    if (requested) chosen.push_back(&variant);
  }
  for (const auto& name : only) {
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw std::invalid_argument(experiment.name + ": unknown variant '" + name + "'" +
                                  name_hint(name, known, "there are none"));
  }
  return chosen;
}

std::vector<TaskRun> task_runs(const Experiment& experiment, std::size_t repeats,
                               const std::vector<std::string>& only) {
  std::vector<TaskRun> runs;
  for (const auto* variant : chosen_variants(experiment, only)) {
    for (std::size_t repeat = 1; repeat <= repeats; ++repeat) {
      for (const auto& plant : experiment.plants) runs.push_back({variant, plant, repeat});
    }
  }
  return runs;
}

std::string task_scene_text(const Experiment& experiment, const TaskRun& run) {
  YAML::Node root = YAML::Load(read_file(experiment.scene));
  for (const auto& change : experiment.set) put(root, change);
  for (const auto& change : run.variant->set) put(root, change);
  if (run.plant != kMeasured) root["plant"]["fidelity"] = run.plant;
  root["seed"] = std::to_string(experiment.seed * 1000 + run.repeat);
  SeededDraw draw(experiment.seed, run.repeat);
  for (const auto& change : experiment.vary) vary(root, change, draw);
  return yaml_text(root) + "\n";
}

nlohmann::ordered_json timeline_of(const std::string& scene_text) {
  const YAML::Node root = YAML::Load(scene_text);
  auto list = nlohmann::ordered_json::array();
  if (!root["timeline"]) return list;
  for (const auto& event : root["timeline"]) {
    for (const auto& pair : event) {
      if (pair.first.Scalar() == "at_s") continue;
      list.push_back({{"at_s", yaml_json(event["at_s"])}, {"what", pair.first.Scalar()}});
    }
  }
  return list;
}

Scene task_scene(const Experiment& experiment, const TaskRun& run, const Registry& registry) {
  const std::string text = task_scene_text(experiment, run);
  try {
    Scene scene = parse_scene(text, experiment.scene, registry);
    refuse_carried_arms(scene, "an experiment");
    if (!scene.timeline.empty() && scene.duration_s > 0 && scene.timeline.back().at_s >= scene.duration_s)
      throw ConfigError(scene.timeline.back().place,
                        "the scene ends before this event; "
                        "raise duration_s or remove the event");
    return scene;
  } catch (const ConfigError& error) {
    // Line numbers refer to the changed text. An error in the file itself is reported with its own line.
    (void)load_scene(experiment.scene, registry);
    throw ConfigError({experiment.path, 0},
                      "variant '" + run.variant->name + "', plant '" + run.plant +
                          "': the scene with the experiment's values is invalid: " + error.what());
  }
}

}  // namespace multipanda
