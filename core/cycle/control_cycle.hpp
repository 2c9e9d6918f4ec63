#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/cycle/backend.hpp"
#include "core/geometry/shape.hpp"
#include "core/model/model_terms.hpp"
#include "core/modes/multimode_controller.hpp"
#include "core/record/cycle_record.hpp"
#include "core/safety/safety.hpp"
#include "core/state/arm_condition.hpp"
#include "core/state/external_force.hpp"
#include "core/state/force_sensor.hpp"
#include "core/types/tick.hpp"

namespace multipanda {

// The data of one cycle: one block per stage, one element per arm. Allocated once, before the loop.
struct CycleData {
  CycleData(std::span<const std::shared_ptr<const ArmModel>> models, std::vector<Obstacle> fixed)
      : obstacles(std::move(fixed)) {
    state.resize(models.size());
    condition.resize(models.size());
    command.resize(models.size());
    for (std::size_t i = 0; i < models.size(); ++i) {
      const JointVector zero = joint_constant(models[i]->joint_count(), 0);
      terms.emplace_back(models[i]);
      state[i].q = models[i]->q_home();
      state[i].dq = state[i].tau_J = zero;  // tau_J_d stays empty if the backend does not provide it
      tau_controllet.push_back(zero);
      tau_feature.push_back(zero);
      tau_cmd.push_back(zero);
      command[i].tau_cmd = zero;
    }
  }

  // CLOCK
  Tick tick;          // this step's number, time and arms due
  StageTimes stages;  // duration of each stage

  // READ
  std::vector<ArmState> state;          // from the backend
  std::vector<ArmCondition> condition;  // usability of the arm in that state
  std::vector<Obstacle> obstacles;      // present poses of the world's fixed objects

  // MODEL
  std::vector<ModelTerms> terms;  // at that state, computed on demand

  // CONTROLLETS, FEATURES
  std::vector<JointVector> tau_controllet;  // from the owner's control law (n x 1) [N m]
  std::vector<JointVector> tau_feature;     // from its features (n x 1) [N m]

  // SAFETY
  std::vector<JointVector> tau_cmd;  // within all limits (n x 1) [N m]

  // WRITE
  std::vector<ArmCommand> command;  // sent to the backend
};

// Configuration of a control cycle. Everything is built before the first step.
struct CycleConfig {
  struct Arm {
    std::string name;
    std::shared_ptr<const ArmModel> model;
    SafetyLimits safety;
    std::optional<BaseMount> mount = {};  // of an arm that stands on another one
    double observer_hz =
        0;  // of the observer, also in place of the backend's estimate; 0: only where it has none
    std::optional<ForceSensorMount> force_sensor = {};  // in place of both
  };
  std::vector<Arm> arms;  // the arms of the backend, in its order
  std::vector<InstanceConfig> controllets;
  std::vector<Obstacle> obstacles;  // fixed objects of the world at the start, for collision avoidance
  std::size_t record_capacity = 0;  // cycles that the writer may lag behind; 0: no record
};

// Every millisecond: reads the state of every arm, runs the active controllets and their features, applies
// the safety stage, and writes the torques. Model terms are computed on demand, at most once per cycle.
class ControlCycle {
 public:
  // Throws std::invalid_argument if arms, models and controllets do not match.
  // `spent`: a cycle of the same config and registry that has run, on any backend; its large parts are used
  // again, as new. The result is that of building all of it, to the bit.
  ControlCycle(const CycleConfig& config, const Registry& registry, Backend& backend,
               std::unique_ptr<ControlCycle> spent = nullptr);
  ControlCycle(const ControlCycle&) = delete;

  // One step for the arms whose packet arrived. Loop thread.
  void step(ArmSet due) noexcept;
  // Runs steps on the backend's clock until `keep_on` returns false or the backend ends. Loop thread.
  template <typename KeepOn>
  void run(KeepOn keep_on) {
    while (keep_on()) {
      const ArmSet due = backend_.wait();
      if (due.empty() && backend_.ended()) return;
      step(due);
    }
  }

  MultimodeController& modes() { return *modes_; }
  const MultimodeController& modes() const { return *modes_; }
  SafetyStage& safety() { return safety_; }
  RecordRing* record() { return record_.get(); }
  const RecordLayout& layout() const { return layout_; }
  const CycleData& data() const { return data_; }  // loop thread
  // State, decisions and commands of the last step for an arm. Loop thread.
  void take_sample(ArmIndex arm, ArmSample& sample) const;
  Backend& backend() { return backend_; }

 private:
  void read(ArmSet due);
  void place_bases();
  void read_obstacles();
  void count_torque(ArmIndex arm);
  void estimate_force(ArmIndex arm);
  void feel(ArmIndex arm);
  void write();
  void record_cycle();

  Backend& backend_;
  CycleData data_;
  std::vector<ExternalForceObserver> observers_;    // one per arm
  std::vector<std::optional<SensedForce>> sensed_;  // of arms with a force sensor
  ArmSet observed_;                                 // arms whose backend does not deliver external torques
  ArmSet every_command_arrives_;                    // according to their backend
  std::vector<std::optional<BaseMount>> mounts_;    // one per arm
  std::vector<std::uint32_t> seen_config_;          // configuration of each arm in the last cycle
  std::vector<std::size_t> placed_;                 // obstacles that the backend's world may move
  SafetyStage safety_;
  std::unique_ptr<MultimodeController> modes_;
  RecordLayout layout_;
  std::unique_ptr<RecordRing> record_;
};

}  // namespace multipanda
