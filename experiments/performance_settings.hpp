#pragma once

#include <optional>
#include <string>
#include <vector>

#include "experiments/experiment.hpp"
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

}  // namespace multipanda
