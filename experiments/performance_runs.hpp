#pragma once

#include <filesystem>

#include "experiments/kinds.hpp"
#include "experiments/performance_settings.hpp"

// The parts of an experiment of the kind `performance`. Each runs its own session and returns the data of the
// page, with the names of the files that it wrote to `folder`.
namespace multipanda {

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
  // On arms: the extent of its rehearsal. A run that goes beyond it, and an arm that stops, end it with
  // ExperimentInterrupted.
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
// second, unpaced run without switches gives the reference that the bystander arm must equal to the bit.
nlohmann::ordered_json run_switching(const PerformanceRun& run);

}  // namespace multipanda
