#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "scene/rewrite.hpp"

// An experiment as read from experiments/*.yaml (docs/experiments.md), checked as far as possible without
// running it.
namespace multipanda {

class Archive;

// One variant of the experiment: a combination of the choices of its axes, or a single one.
struct ExperimentVariant {
  std::string name;               // "mu01_k10"
  std::string label;              // "friction 0.1, 10 kN/m"
  std::vector<std::string> tags;  // names of its choices, and its own name
  std::vector<Override> set;
  bool reported = false;  // shown; only limits that name it apply
};

// Upper and lower limits of a figure, checked in the worst repeat.
struct ExperimentLimit {
  std::string metric;
  std::map<std::string, double> at_most, at_least;  // by plant
  std::vector<std::string> variants;                // names or tags; empty: all that are not `reported`
};

// A figure published by others for the same task.
struct PublishedFigure {
  std::string metric;  // empty: no figure here corresponds
  double value = 0;
  std::string text;
};

struct Experiment {
  std::string name;  // name of the file: "task-3"
  std::string kind;  // selects the runner and the page (kinds.hpp)
  std::string title;
  std::string description;
  std::string path;
  std::uint64_t seed = 1;
  std::size_t repeats = 5;
  std::vector<ExperimentLimit> limits;
  std::vector<PublishedFigure> published;
  std::vector<std::string> show;  // figures shown as bars without a limit

  // Kind `task`
  std::string scene;  // path of the scene file
  std::vector<Override> set;
  std::vector<std::string> plants;          // values of plant.fidelity
  std::vector<ExperimentVariant> variants;  // at least one
  std::vector<Variation> vary;
  nlohmann::ordered_json measure;  // for experiments/pages, keys checked

  // Other kinds: settings that their runner reads.
  nlohmann::ordered_json settings;
};

// Names of all experiments, sorted.
std::vector<std::string> available_experiments();
// Folder of the experiments, with their scenes in scenes/.
std::string experiments_folder();

// Loads by name, or by path (with a slash or ending in .yaml). Throws ConfigError with file, line, the value
// found, the value expected and the nearest valid name.
Experiment load_experiment(const std::string& name_or_path);
Experiment parse_experiment(const std::string& text, const std::string& file_name);

// Keys that the files of experiments and of studies share. The section `set`: values by key path, as YAML.
std::vector<Override> read_overrides(Archive& archive, const char* doc);
void visit(Archive& archive, ExperimentVariant& variant);
void visit(Archive& archive, Variation& variation);

}  // namespace multipanda
