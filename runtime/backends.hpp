#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/cycle/backend.hpp"
#include "core/modes/registry.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// Backend of the arms.
enum class BackendKind : std::uint8_t {
  as_scene,  // according to the scene's key `backend`; without it, arms with the key `fci` are real, the
             // others simulated
  mujoco,    // all arms are simulated in this process
  fci,       // all arms are real, or virtual arms of another process
  // The arms are virtual arms in this process. The run controls them through sockets
  // and the complete control interface.
  virtual_arms,
  pinocchio,    // all arms are simulated without contact
  replay,       // the states of a log; torques are computed and compared with the recorded ones
  from_library  // a backend of a library that the scene names in `plugins`
};

// Names for the command line and the scene's key, without those of libraries: "virtual".
std::vector<std::string> backend_names();

struct BackendOptions {
  BackendKind kind = BackendKind::as_scene;
  // By arm name; replaces the scene's address. Arms named here are real (with `as_scene` and `fci`).
  std::vector<std::pair<std::string, std::string>> addresses;
  // `virtual_arms` of a paced run: steps begin every millisecond, but the arms' world waits for commands, so
  // that none is late on a busy computer. The arms of an unpaced run always wait.
  bool lockstep = false;
  // `virtual_arms` of fidelity `realistic`: sensors as of real arms. Off: as of arms in this process.
  bool real_sensors = true;
  std::filesystem::path log;  // of `replay`: log.mcap, or the folder of a run
  std::string type;           // of `from_library`: the name in the registry
};

// "mujoco", "fci", ...; empty: the choice of the scene or a library's backend.
std::string name_of(BackendKind kind);
// The options for a backend by name; a name that is not one of backend_names() means a library's backend.
BackendOptions backend_named(const std::string& name);

// Whether all arms are simulated in this program: false with real arms and with a library's backend.
bool is_simulated(const Scene& scene, const BackendOptions& options);

// The scene with SceneArm::fci set for exactly the arms that are real. With `fci`, an arm without an address
// gets a loopback address: 127.0.0.1 the first of the scene, 127.0.0.2 the second, ... Throws
// std::invalid_argument: addresses of arms that are simulated or do not exist, or one address for two arms;
// ConfigError (an invalid_argument): a carried arm with another backend than `mujoco`.
Scene with_connections(Scene scene, const BackendOptions& options);

struct BackendSet {
  std::unique_ptr<Backend> backend;
  std::string description;  // "mujoco", "left fci 172.16.0.2, right mujoco"
};

struct BackendPace {
  bool paced = true;
  // Shows the user a message. From threads of the backend, one call at a time.
  std::function<void(const std::string&)> report;
};

// The backend of a scene from with_connections(). Unpaced: as fast as the loop runs; real arms are then
// expected to be virtual ones in lock-step on this computer, others are refused. Nothing is connected before
// Backend::start(). Throws std::invalid_argument (impossible scene, unknown backend) or std::runtime_error
// (the log cannot be read).
BackendSet make_backend(const Scene& scene, const Registry& registry, const BackendOptions& options,
                        const BackendPace& pace);

}  // namespace multipanda
