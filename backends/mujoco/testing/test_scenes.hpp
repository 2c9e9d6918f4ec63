#pragma once

// Handwritten scenes for the tests of the MuJoCo backend, and a loop without a controller.
#include <cmath>
#include <random>
#include <vector>

#include "backends/mujoco/mujoco_backend.hpp"
#include "models/arm_source.hpp"

namespace multipanda::test {

inline JointVector ready() {
  JointVector q(7);
  q << 0, -M_PI / 4, 0, -3 * M_PI / 4, 0, M_PI / 2, M_PI / 4;
  return q;
}

inline SceneArm arm_named(const std::string& name, const Pose& X_WB = {}, bool hand = true) {
  SceneArm arm;
  arm.name = name;
  arm.X_WB = X_WB;
  arm.hand = hand;
  arm.q_start = ready();
  return arm;
}

inline Pose pose(double x, double y, double z, double roll = 0, double pitch = 0, double yaw = 0) {
  return {rotation_from_rpy({roll, pitch, yaw}), {x, y, z}};
}

inline Scene scene_of(std::vector<SceneArm> arms, PlantFidelity plant = {}) {
  Scene scene;
  scene.arms = std::move(arms);
  scene.plant = std::move(plant);
  return scene;
}

// The controllers' model of a scene's arm, built separately from the backend's.
inline ModelTerms terms_of(const SceneArm& arm) {
  return ModelTerms(
      std::make_shared<const ArmModel>(arm_model_source(load_robot(arm.model), arm.X_WB, arm.hand)));
}

struct Loop {
  explicit Loop(const Scene& scene) : backend(scene, {.pace = Pace::unpaced}) {
    states.resize(backend.arm_count());
    commands.resize(backend.arm_count());
    for (std::size_t i = 0; i < commands.size(); ++i) {
      commands[i].tau_cmd = joint_constant(scene.arms[i].q_start.size(), 0);
    }
    backend.start();
    due = backend.wait();
    backend.read(due, states);
  }
  // Sends `commands`, then takes the states of the next cycle.
  void step() {
    backend.write(due, commands);
    due = backend.wait();
    backend.read(due, states);
  }
  void steps(int count) {
    for (int i = 0; i < count; ++i) step();
  }
  // Steps until `tau` is commanded, at most 1 N m per step and joint: faster is an error.
  void lead_to(const JointVector& tau, std::size_t arm = 0) {
    JointVector& now = commands[arm].tau_cmd;
    while (now != tau) {
      now += (tau - now).cwiseMax(-1).cwiseMin(1);
      if ((tau - now).cwiseAbs().maxCoeff() < 1e-9) now = tau;
      step();
    }
  }
  // Disables the arms' own limits and contacts, for plants whose state is set (set_plant).
  void unwatch() {
    for (ArmIndex i = 0; i < states.size(); ++i) backend.arm(i).watch(false);
  }
  const ArmState& state(std::size_t i = 0) const { return states[i]; }

  MujocoBackend backend;
  ArmSet due;
  std::vector<ArmState> states;
  std::vector<ArmCommand> commands;
};

// Sets the state of the plant, not the start of the arm.
inline void set_plant(MujocoBackend& backend, std::size_t arm, const JointVector& q, const JointVector& dq) {
  const auto& places = backend.world().arm(arm);
  for (std::size_t j = 0; j < places.qpos.size(); ++j) {
    backend.world().data()->qpos[places.qpos[j]] = q[static_cast<Eigen::Index>(j)];
    backend.world().data()->qvel[places.dof[j]] = dq[static_cast<Eigen::Index>(j)];
  }
}

inline JointVector random_between(const JointVector& low, const JointVector& high, std::mt19937& random) {
  std::uniform_real_distribution<double> unit(0.1, 0.9);
  JointVector v = low;
  for (Eigen::Index i = 0; i < v.size(); ++i) v[i] += unit(random) * (high[i] - low[i]);
  return v;
}

}  // namespace multipanda::test
