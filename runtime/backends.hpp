#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/cycle/backend.hpp"
#include "fci/client/arm_statistics.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// Whose arms a run drives.
enum class ArmsFrom : std::uint8_t {
  scene,   // arms with the key `fci` are real, the others simulated
  mujoco,  // all simulated, in this process
  fci,     // all real, or virtual ones of another process
  // All virtual, in this process: the scene behind virtual arms, driven through sockets, with everything of
  // the control interface in between.
  virtual_arms
};

std::string_view name_of(ArmsFrom arms);  // as on the command line: "virtual"

struct BackendOptions {
  ArmsFrom arms = ArmsFrom::scene;
  // By arm name; in place of what the scene says. An arm named here is real (with `scene` and `fci`).
  std::vector<std::pair<std::string, std::string>> addresses;
  // `virtual_arms` of a paced run: a step begins every millisecond, but the arms' world waits for its
  // commands, so that nothing is late for an arm however busy the computer is. An unpaced run's arms always
  // wait.
  bool lockstep = false;
};

// The scene with SceneArm::fci set for exactly the arms that are real. With `fci`, an arm without any address
// gets a loopback one: 127.0.0.1 the first of the scene, 127.0.0.2 the second, ...
// Throws std::invalid_argument: addresses of arms that are simulated or do not exist, two arms at one.
Scene with_arms_from(Scene scene, const BackendOptions& options);

struct BackendSet {
  std::unique_ptr<Backend> backend;
  // How the packets of an arm fare, any thread; nothing for simulated arms.
  std::function<std::optional<fci::ArmStatistics>(ArmIndex)> link;
  std::string description;  // "mujoco", "left fci 172.16.0.2, right mujoco"
};

struct BackendPace {
  bool paced = true;
  bool lockstep = false;  // as BackendOptions has it
  // What a user should know and nobody asked for. From threads of the backend, one at a time.
  std::function<void(const std::string&)> say;
};

// The backend of a scene that with_arms_from() has been through. Not paced: as fast as the loop runs; real
// arms are then expected to be virtual ones in lock-step. Nothing is connected before Backend::start().
// Throws std::invalid_argument (a scene that cannot be).
BackendSet make_backend(const Scene& scene, ArmsFrom arms, const BackendPace& pace);

}  // namespace multipanda
