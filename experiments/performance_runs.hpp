#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "experiments/experiment.hpp"
#include "experiments/kinds.hpp"
#include "scene/load.hpp"

namespace multipanda {

// The `settings` of an experiment of the kind `performance` (docs/experiments.md).
struct PerformanceSettings {
  struct Condition {
    std::string name, label;
    std::vector<Override> set;  // on top of the scene
    std::string course;         // path of the motion generator's course
    std::string controllet;     // instance that follows it
  };
  struct Switching {
    std::string scene;
    std::size_t trials = 50;               // of each kind
    std::vector<std::string> controllets;  // two that alternate
    std::string controllet, feature;       // switched on and off
    std::string bystander;                 // arm that the switches do not affect
  };
  struct DelayCheck {
    std::vector<double> delays_s;
    double duration_s = 2;
    std::vector<Override> set;
  };

  std::string scene;
  std::string plant = "realistic";
  double duration_s = 30, fast_duration_s = 3;  // of each condition, and with --fast
  double lead_s = 1;                            // from the first set-point to the first cycle that counts
  double usage_every_s = 0.3;                   // between two readings of CPU and memory
  std::vector<Condition> conditions;
  std::optional<Switching> switching;
  std::optional<DelayCheck> delay_check;
};

// Throws ConfigError with the value found and the value expected.
PerformanceSettings performance_settings(const Experiment& experiment);

// A scene file with changes, on a plant, as text and as a checked scene.
std::string changed_scene_text(const Experiment& experiment, const std::string& scene,
                               const std::string& plant, const std::vector<Override>& set);
OpenedScene changed_scene(const Experiment& experiment, const std::string& scene, const std::string& plant,
                          const std::vector<Override>& set);

// The parts of an experiment of the kind `performance`. Each runs its own session and returns the data of the
// page, with the names of the files that it wrote to `folder`.
struct PerformanceRun {
  const Experiment& experiment;
  const PerformanceSettings& settings;
  const ExperimentProgress& progress;
  std::filesystem::path folder;
  bool fast = false;
  BackendOptions backend;
  SessionViewer* viewer = nullptr;
  bool ros = false;  // set-points come by ROS topics
  // A run in simulation before one on arms: its record has "extent", the arms' motion (motion_extent.hpp).
  bool rehearsal = false;
  // On arms: the extent of its simulation. The run ends with ExperimentInterrupted if it exceeds that, or if
  // an arm stops.
  nlohmann::ordered_json expected = {};
  bool on_arms() const { return backend.kind == BackendKind::fci || backend.kind == BackendKind::as_scene; }
};

// A paced run with set-points at 1 kHz from a motion generator in a separate process. Throws
// std::runtime_error if the generator or the run fails.
nlohmann::ordered_json run_condition(const PerformanceRun& run,
                                     const PerformanceSettings::Condition& condition, std::size_t repeat);

// An unpaced run whose set-point the scene moves. The command delay of the plant is known, and both methods
// of measurement must find it.
nlohmann::ordered_json run_delay_check(const PerformanceRun& run, double delay_s);

// A paced run with switches of controllets and of a feature, requested at random times. With simulated arms a
// second, unpaced run without switches gives the reference that the bystander arm must match bit for bit.
nlohmann::ordered_json run_switching(const PerformanceRun& run);

}  // namespace multipanda
