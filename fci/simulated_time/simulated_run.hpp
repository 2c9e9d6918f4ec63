#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "core/cycle/control_cycle.hpp"
#include "core/modes/registry.hpp"
#include "fci/simulated_time/simulated_time.hpp"

namespace multipanda::fci {

struct SimulatedRunOptions {
  SimulatedTimeOptions time;
  bool timeline = true;                // the scene's timeline; its `active` controllets start in any case
  std::optional<Registry> registry{};  // none: the built-in laws and those of the scene's libraries
};

// A scene's whole run in simulated time, cycle by cycle: the control cycle on strict virtual arms, in one
// thread. For endurance runs and tests:
//
//   SimulatedRun run(scene, {.time = {.seed = 7}});
//   run.after_cycle = [&](const CycleRecord& cycle) { ... };
//   run.begin();
//   while (run.step() && run.time_s() < 3600) { faults, requests }
//   run.end();
class SimulatedRun {
 public:
  // Throws std::invalid_argument, std::runtime_error (a library cannot be loaded).
  explicit SimulatedRun(const Scene& scene, SimulatedRunOptions options = {});

  void begin();  // every arm in torque control
  bool step();   // one cycle; false: the backend has ended
  void run_for(double duration_s);
  void end();

  // Called after each cycle, with its record: owners, states, torques sent, outputs of the controllets
  // (including energy balances; layout() has their places).
  std::function<void(const CycleRecord&)> after_cycle;
  // Each event of the cycle: switches, interventions, refusals.
  std::function<void(const Event&)> on_event;

  // Sends requests and runs cycles until they are answered.
  Answer ask(const Request& request);
  RequestAnswer ask(ArmIndex arm, ArmRequest request);

  double time_s() const { return world_.now().seconds(); }
  SimulatedTime& world() { return world_; }
  ControlCycle& cycle() { return *cycle_; }
  MultimodeController& modes() { return cycle_->modes(); }
  const CycleData& data() const { return cycle_->data(); }  // states, ArmCondition, torques
  const RecordLayout& layout() const { return cycle_->layout(); }
  ArmSet due() const { return due_; }  // of the last cycle

 private:
  Registry registry_;
  SimulatedTime world_;
  std::unique_ptr<ControlCycle> cycle_;
  ArmSet due_;
};

}  // namespace multipanda::fci
