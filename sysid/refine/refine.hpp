#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "core/modes/registry.hpp"
#include "experiments/experiment.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"
#include "sysid/comparison/compare.hpp"
#include "sysid/excitation/excitation_motion.hpp"
#include "sysid/measured/measured_log.hpp"

namespace multipanda {

// The arms to be modeled. They return only logs.
struct RefineTarget {
  std::optional<std::uint64_t> hidden;  // virtual arms of another process, drawn from this seed
  // Adds properties that no identified model can express: elastic joints (10,000 N m/rad on average) measured
  // at their motors, gear ripple (0.2 N m), and half of the rotors' inertia.
  bool motors = false;
  std::vector<std::pair<std::string, std::string>> addresses;  // otherwise real arms: name, address
  // Otherwise virtual arms of this process, whose models are in these files (arm -> file): for tests.
  std::map<std::string, std::string> known;

  std::string words() const;  // human-readable: "hidden plants of seed 3"
};

// One run of a scene.
struct ArmRun {
  std::string name;        // of the log
  std::string scene;       // text; relative paths in it start at RunSettings::scene_path's folder
  bool on_target = false;  // otherwise in simulation
};

struct RunSettings {
  RefineTarget target;
  std::string scene_path;
  std::filesystem::path program;  // multipanda itself, for hidden plants
  std::filesystem::path logs;     // existing folder for NAME.mcap
  std::size_t workers = 2;        // parallel runs; real arms: one
  const std::atomic<bool>* stop = nullptr;
};

struct ArmRunResult {
  std::string name;
  std::filesystem::path log;
  std::vector<std::string> faults;  // failures; empty: none
  double time_s = 0, elapsed_s = 0;
};

// Executes all runs, in any order and in parallel; results are in the order of `runs`. Calls `finished` after
// each run, never concurrently. If stopped, there are fewer results than runs. Rethrows the exception of the
// first failed run.
std::vector<ArmRunResult> run_all(const std::vector<ArmRun>& runs, const RunSettings& settings,
                                  const std::function<void(const ArmRunResult&)>& finished = {});

// Adapts a task's simulation to its arms (docs/identification.md): runs the task on the arms and in
// simulation and compares; runs an exciting motion on the arms and identifies a model of each; simulates the
// task with these models and compares again.

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

// The motion of the first arm in an excitation's scene file (written by `excite`).
struct ExcitationFile {
  std::string path;
  ExcitationMotion motion;
  double max_speed = 0;  // speed that the input must allow [rad/s]
};
// Throws ConfigError, or std::invalid_argument if the scene has no motion of joints.
ExcitationFile read_excitation(const std::string& path, const Registry& registry);

// The shipped excitation for a model: experiments/scenes/excitation_MODEL.yaml. Throws std::invalid_argument
// if there is none.
std::string excitation_path(const std::string& model);

// A run in which the arms of a scene perform their excitations in turn; of the other objects only floors
// remain. Arms that stand close together face away from each other by turning their first joint, also while
// they wait.
struct ExcitationRun {
  std::string scene;  // text
  struct Window {
    std::string arm;
    double begin = 0, end = 0;  // of its motion, in the log's time [s]
  };
  std::vector<Window> windows;
};
// `excitations`: one per arm. Throws std::invalid_argument for an arm that cannot face away within its range.
ExcitationRun excitation_run(const Scene& scene, const std::vector<ExcitationFile>& excitations,
                             const std::vector<RobotDescription>& robots, std::uint64_t seed);

// Moves the arms to the scene's start from any position: for real arms, before a task.
std::string approach_scene(const Scene& scene);

}  // namespace multipanda
