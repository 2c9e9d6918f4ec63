#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "analysis/comparison/compare.hpp"
#include "experiments/experiment.hpp"
#include "experiments/refine/arm_runs.hpp"

// A task's simulation brought nearer to the arms that it is about (docs/refine.md): the task on the arms and
// in simulation, the distance between them; an exciting motion on the arms, a model of each of them from its
// logs, the simulation again with these models, the distance again.
namespace multipanda {

struct RefineOptions {
  RefineTarget target;
  std::size_t rounds = 1;
  std::size_t repeats = 3;          // of the task, on the arms and in every simulation
  std::string variant;              // of the experiment; empty: its first one that counts
  std::string plant = "realistic";  // plant.fidelity of the simulation, before and after
  std::vector<std::string>
      excitations;  // scene files, one for all arms or one per arm; empty: the shipped ones
  std::size_t excitation_repeats = 1;  // per round
  std::string family;                  // of friction, see identify; empty: the best in cross-validation
  std::filesystem::path directory;     // for everything; must exist
  std::filesystem::path program;       // multipanda itself; empty: this program
  std::size_t workers = 2;             // runs at once
  bool page = true;                    // report.html
};

struct RefineProgress {
  std::function<void(const std::string& line)> line;  // called from several threads, one at a time
  const std::atomic<bool>* stop = nullptr;
};

// The model that a round found of one arm.
struct RefinedArm {
  std::string arm;
  std::filesystem::path model;   // file
  nlohmann::ordered_json found;  // figures of the identification
  std::vector<std::string> warnings;
};

struct RefineRound {
  std::vector<RefinedArm> arms;
  std::vector<Comparison> comparisons;               // per arm
  std::vector<std::vector<QuantityChange>> changes;  // per arm: against the simulation before the first round
};

struct RefineResult {
  bool stopped = false;
  std::string variant;
  std::vector<Comparison> before;  // per arm: arms against nominal simulation
  std::vector<RefineRound> rounds;
  std::vector<std::string> faults;  // runs that did not go as asked
  std::filesystem::path page;
  nlohmann::ordered_json json;  // as refine.json
};

// Any thread; takes minutes. Throws std::invalid_argument (an experiment, a variant or a target that cannot
// be), LogRefused (logs that tell nothing), std::runtime_error.
RefineResult refine(const Experiment& experiment, const RefineOptions& options,
                    const RefineProgress& progress);

// The part of a log from `begin` to `end` seconds, as stamped.
MeasuredLog cut(const MeasuredLog& log, double begin, double end);

}  // namespace multipanda
