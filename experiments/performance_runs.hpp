#pragma once

#include <filesystem>

#include "experiments/kinds.hpp"
#include "experiments/performance_settings.hpp"

// The parts of an experiment of the kind `performance`. Each runs a session of its own and returns what the
// page needs, with the names of the files it left in `folder`.
namespace multipanda {

struct PerformanceRun {
  const Experiment& experiment;
  const PerformanceSettings& settings;
  const ExperimentProgress& progress;
  std::filesystem::path folder;
  bool fast = false;
  BackendOptions backend;
  bool ros = false;  // set-points come by ROS topics
};

// Paced; set-points at 1 kHz from a motion generator, which is a process of its own. Throws
// std::runtime_error if the generator or the run does not do as it should.
nlohmann::ordered_json run_condition(const PerformanceRun& run,
                                     const PerformanceSettings::Condition& condition, std::size_t repeat);

// Unpaced, the set-point moved by the scene: the command delay of the plant is known, the two ways of
// measuring it must find it.
nlohmann::ordered_json run_delay_check(const PerformanceRun& run, double delay_s);

// Paced: as many switches of controllets and of a feature, asked for at random moments. And once more without
// them, unpaced, for what the bystander must have done to the bit.
nlohmann::ordered_json run_switching(const PerformanceRun& run);

}  // namespace multipanda
