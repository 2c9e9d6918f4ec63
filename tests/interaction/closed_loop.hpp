#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "core/model/model_terms.hpp"
#include "scene/scene.hpp"

// Runs the first controllet of a scene in lock-step and measures it by the plant's own state: the loop that
// the trials of one arm and of two share.
namespace multipanda::interaction {

// One cycle, all arms of the scene together.
struct PlantSample {
  double t = 0;            // [s]
  double kinetic = 0;      // 1/2 dq^T M dq of the plant's joints [J]
  double environment = 0;  // energy that the contacts put into the arms since the start [J]
  double rate = 0;         // largest change of a joint's torque before the limiter [N m/s]
  std::vector<double> outputs;
};

struct Outcome {
  std::vector<OutputSpec> outputs;
  std::uint64_t interventions = 0;  // of the safety stage, limiter included
  bool kept = true;                 // the law still owned all arms at the end
  std::string fault;                // of the simulation
  std::string rules;                // of the safety stage that intervened, with their counts

  // First number of an output among those of a sample. Throws std::invalid_argument for an unknown output.
  std::size_t column(const std::string& output) const;
};

struct Loop {
  MujocoBackend& backend;
  ControlCycle& cycle;
  Instance& law;
  std::vector<ModelTerms>& terms;  // of each arm, at the plant's joints without the measurement's noise
};
using BeforeStep = std::function<void(double t, MujocoBackend&, ControlCycle&)>;
using AfterStep = std::function<void(PlantSample, const Loop&)>;

// `before` may change the world before each step; `after` gets each sample. `duration_s` 0: the scene's.
Outcome run_closed_loop(const Scene& scene, double duration_s, const BeforeStep& before,
                        const AfterStep& after);

// Scenes of the experiments ("task_3"), to be changed one thing at a time.
Scene task(const std::string& name);
void set(Scene& scene, const std::string& parameter, std::vector<double> values);  // of the first controllet
SceneObject& object(Scene& scene, const std::string& name);  // throws std::invalid_argument if it is missing

}  // namespace multipanda::interaction
