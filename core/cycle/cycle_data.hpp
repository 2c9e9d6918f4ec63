#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "core/cycle/backend.hpp"
#include "core/geometry/shape.hpp"
#include "core/model/model_terms.hpp"
#include "core/record/cycle_record.hpp"
#include "core/state/arm_condition.hpp"
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

}  // namespace multipanda
