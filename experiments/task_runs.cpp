#include "experiments/task_runs.hpp"

#include <algorithm>
#include <fstream>
#include <stdexcept>

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include "common/text.hpp"
#include "experiments/on_arms.hpp"
#include "scene/build.hpp"
#include "scene/rewrite.hpp"
#include "yaml_reader/node.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

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
  YAML::Node root = YAML::Load(read_text(experiment.scene));
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
      list.push_back({{"at_s", event["at_s"].as<double>()}, {"what", pair.first.Scalar()}});
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
                        "the scene ends before this event; raise duration_s or remove the event");
    return scene;
  } catch (const ConfigError& error) {
    // Line numbers refer to the changed text. An error in the original file is reported with its own line.
    (void)load_scene(experiment.scene, registry);
    throw ConfigError({experiment.path, 0},
                      "variant '" + run.variant->name + "', plant '" + run.plant +
                          "': the scene with the experiment's values is invalid: " + error.what());
  }
}

Json what_decides(const Experiment& experiment, const ExperimentOptions& options, const std::string& scenes) {
  Json what = describe(experiment);
  for (const char* shown : {"machine", "description", "published", "show", "limits"}) what.erase(shown);
  Json addresses = Json::object();
  for (const auto& [arm, address] : options.backend.addresses) addresses[arm] = address;
  what["fast"] = options.fast;
  what["backend"] = name_of(options.backend.kind);
  what["addresses"] = addresses;
  what["runs_and_scenes"] = fmt::format("{:016x}", std::hash<std::string>{}(scenes));
  return what;
}

FinishedRuns::FinishedRuns(fs::path folder, Json what, bool resume)
    : file_(std::move(folder) / "finished_runs.json"), what_(std::move(what)) {
  if (!resume) return;
  std::ifstream in(file_);
  const Json read = Json::parse(in, nullptr, false);
  if (!in || !read.is_object() || !read.contains("what") || !read.contains("runs"))
    throw std::invalid_argument(fmt::format("{} has no interrupted experiment: there is no valid {}",
                                            file_.parent_path().string(), file_.filename().string()));
  for (const auto& [key, value] : what_.items()) {
    const Json before = read["what"].value(key, Json());
    if (before != value)
      throw std::invalid_argument(
          fmt::format("{} was started with another {}: {}, now {}; resume it with the same arguments",
                      file_.parent_path().string(), key, before.dump(), value.dump()));
  }
  for (const auto& [name, record] : read["runs"].items()) runs_.emplace(name, record);
}

const Json* FinishedRuns::find(const std::string& run) const {
  const auto found = runs_.find(run);
  return found == runs_.end() ? nullptr : &found->second;
}

void FinishedRuns::add(const std::string& run, const Json& record) {
  runs_[run] = record;
  const fs::path part = file_.string() + ".part";
  std::ofstream out(part, std::ios::trunc);
  out << Json{{"what", what_}, {"runs", runs_}}.dump(1, ' ', false, Json::error_handler_t::replace) << '\n';
  out.close();
  if (!out) throw std::runtime_error("cannot write " + part.string() + "; check the free disk space");
  fs::rename(part, file_);
}

void FinishedRuns::remove_file() const {
  std::error_code ignored;
  fs::remove(file_, ignored);
}

}  // namespace multipanda
