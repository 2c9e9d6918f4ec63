#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "experiments/experiment.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"
#include "sysid/comparison/compare.hpp"
#include "sysid/measured/measured_log.hpp"
#include "sysid/refine/arm_runs.hpp"

// Adapts a task's simulation to its arms (docs/identification.md): runs the task on the arms and in
// simulation and compares; runs an exciting motion on the arms and identifies a model of each; simulates the
// task with these models and compares again.
namespace multipanda {

struct RefineOptions {
  RefineTarget target;
  std::size_t rounds = 1;
  std::size_t repeats = 3;          // of the task, on the arms and in every simulation
  std::string variant;              // of the experiment; empty: its first reported one
  std::string plant = "realistic";  // plant.fidelity of the simulation, before and after
  // Scene files, one for all arms or one per arm; empty: the shipped ones.
  std::vector<std::string> excitations;
  std::size_t excitation_repeats = 1;  // per round
  std::string family;                  // friction family, see identify; empty: the best in cross-validation
  std::filesystem::path directory;     // for all files; must exist
  std::filesystem::path program;       // multipanda itself; empty: this program
  std::size_t workers = 2;             // runs at once
  bool page = true;                    // report.html
};

struct RefineProgress {
  std::function<void(const std::string& line)> line;  // called from several threads, never concurrently
  const std::atomic<bool>* stop = nullptr;
};

// The model of one arm from one round.
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
  std::vector<std::string> faults;  // runs that failed
  std::filesystem::path page;
  nlohmann::ordered_json json;  // as refine.json
};

// Any thread; takes minutes. Throws std::invalid_argument for an unsuitable experiment, variant or target,
// LogRefused for unusable logs, and std::runtime_error.
RefineResult refine(const Experiment& experiment, const RefineOptions& options,
                    const RefineProgress& progress);

// The part of a log from `begin` to `end` seconds, as stamped.
MeasuredLog cut(const MeasuredLog& log, double begin, double end);

// The whole refinement as JSON; docs/identification.md has the keys.
nlohmann::ordered_json refine_json(const Experiment& experiment, const ExperimentVariant& variant,
                                   const RefineOptions& options, const RefineResult& result);

// Makes report.html next to refine.json and returns its path. Throws std::runtime_error with
// the script's output.
std::filesystem::path make_refine_page(const std::filesystem::path& json);

struct ArmModelOptions {
  std::string family;          // of friction beyond the torque sensor; empty: chosen by cross-validation
  std::filesystem::path file;  // output file
  std::size_t threads = 2;
};

// Identifies one arm from its logs: masses, friction and tilt from torque at the sensor; delay, bandwidth and
// friction before the sensor from commanded torque. Writes a model file. Throws LogRefused.
RefinedArm identify_arm(const SceneArm& arm, const RobotDescription& prior, std::span<const MeasuredLog> logs,
                        const ArmModelOptions& options);

std::string in_words(const RefinedArm& arm);  // one human-readable line

}  // namespace multipanda
