#pragma once

#include <cstdint>
#include <future>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// One simulated world of a scene with its control loop, stepped by the caller. Not thread-safe.
class LearningWorld {
 public:
  static constexpr std::size_t kArmNumbers = 35, kObjectNumbers = 7;

  LearningWorld(Scene scene, const Registry& registry) : scene_(std::move(scene)), registry_(registry) {}

  // Builds everything again: the state is that of a fresh world of this seed.
  void reset(std::uint64_t seed, bool hidden, const double* q_start, const double* object_poses,
             const std::vector<std::string>& objects, const std::vector<std::string>& active);
  // Queues a set-point, as a sample of a stream, or a parameter that has changed: the loop takes them in the
  // first cycle of the next step(). What it refuses, stopped() and reason() tell. Throws
  // std::invalid_argument: unknown names.
  void target(const std::string& controllet, const std::string& input, const double* values,
              std::size_t count);
  void parameter(const std::string& controllet, const std::string& name, const double* values,
                 std::size_t count);
  // A grasp, or with force 0 a move; sent if it differs from the last one. [m], [N]
  void gripper(std::size_t arm, double width, double force);
  void user_stop(std::size_t arm);  // presses its stop button
  void step(std::size_t cycles);
  // Per arm: q, dq, X_WE (x y z, w x y z), F_K_W_est, F_K_W_true, width of the fingers, grasped.
  // Per object: its pose.
  void write_state(double* arms, double* objects, const std::vector<std::string>& names) const;
  bool stopped() const;  // an arm is held, or a command was refused
  std::string reason() const;

 private:
  void add(Request request);

  Scene scene_;
  const Registry& registry_;
  std::unique_ptr<MujocoBackend> backend_;
  std::unique_ptr<ControlCycle> cycle_;
  mutable std::vector<ModelTerms> terms_;
  std::vector<Request> waiting_;
  std::map<std::pair<InstanceIndex, std::size_t>, std::vector<double>> sent_;
  std::map<std::size_t, std::pair<double, double>> grippers_;
  std::vector<std::future<RequestAnswer>> answers_;
  std::string refusal_;
};

}  // namespace multipanda
