#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "scene/scene_error.hpp"

// An experiment as data: what experiments/*.yaml say (docs/experiments.md), checked as far as it can be
// without running it.
namespace multipanda {

// A value put into the scene file before it is read. The key is a path: "objects.table.friction"; an item of
// a list is found by its name, by its number from 0, or by a key that it has.
struct Override {
  std::string key;
  std::string value;  // as YAML
  SourcePlace place;
};

// A number of the scene, or each of a list, that is moved in every repeat: uniformly within +- `by`, seeded.
struct Variation {
  std::string key;
  double by = 0;
  SourcePlace place;
};

// One way to run the experiment. The combinations of its axes' choices, then the single ones.
struct ExperimentVariant {
  std::string name;               // "mu01_k10"
  std::string label;              // "friction 0.1, 10 kN/m"
  std::vector<std::string> tags;  // names of the choices it is made of, and its own
  std::vector<Override> set;
  bool reported = false;  // shown, but held to no limit that does not name it
};

// What a figure must not exceed, or must reach. Counts for the worst repeat.
struct ExperimentLimit {
  std::string metric;
  std::map<std::string, double> at_most, at_least;  // by plant
  std::vector<std::string> variants;                // names or tags; empty: all that are not only reported
};

// A figure that somebody else published for the same.
struct PublishedFigure {
  std::string metric;  // empty: none of ours corresponds
  double value = 0;
  std::string text;
};

struct Experiment {
  std::string name;  // of the file: "task-3"
  std::string kind;  // which runner and which page; see kinds.hpp
  std::string title;
  std::string description;
  std::string path;
  std::uint64_t seed = 1;
  std::size_t repeats = 5;
  std::vector<ExperimentLimit> limits;
  std::vector<PublishedFigure> published;
  std::vector<std::string> show;  // figures shown as bars although nothing limits them

  // Kind `task`
  std::string scene;  // path of the scene file
  std::vector<Override> set;
  std::vector<std::string> plants;          // values of plant.fidelity
  std::vector<ExperimentVariant> variants;  // at least one
  std::vector<Variation> vary;
  nlohmann::ordered_json measure;  // for analysis/experiments, keys checked

  // Other kinds: whatever their runner reads.
  nlohmann::ordered_json settings;
};

// Names of all experiments, sorted.
std::vector<std::string> available_experiments();
// Folder that holds them, and their scenes in scenes/.
std::string experiments_folder();

// By name, or by path (anything with a slash or ending in .yaml). Throws SceneError: file, line, what was
// found, what was expected, the nearest valid name.
Experiment load_experiment(const std::string& name_or_path);
Experiment parse_experiment(const std::string& text, const std::string& file_name);

}  // namespace multipanda
