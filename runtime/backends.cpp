#include "runtime/backends.hpp"

#include <algorithm>
#include <array>
#include <stdexcept>

#include "backends/replay/replay_backend.hpp"
#include "common/machine.hpp"
#include "common/text.hpp"
#include "fci/client/fci_backend.hpp"
#include "runtime/mixed_backend.hpp"
#include "runtime/simulated.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

void check_addresses(const Scene& scene, const BackendOptions& options) {
  std::vector<std::string> names;
  for (const auto& arm : scene.arms) names.push_back(arm.name);
  for (const auto& [name, address] : options.addresses) {
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      throw std::invalid_argument("an address is given for arm '" + name +
                                  "', but the scene has no such arm" +
                                  name_hint(name, names, "there are none"));
    }
    if (options.kind != BackendKind::as_scene && options.kind != BackendKind::fci) {
      throw std::invalid_argument("an address is given for arm '" + name +
                                  "', but this run has no real arms; omit it, or use --backend fci");
    }
  }
}

struct NamedBackend {
  const char* name;
  BackendKind kind;
};
constexpr std::array<NamedBackend, 5> kBackends{{{"mujoco", BackendKind::mujoco},
                                                 {"fci", BackendKind::fci},
                                                 {"virtual", BackendKind::virtual_arms},
                                                 {"pinocchio", BackendKind::pinocchio},
                                                 {"replay", BackendKind::replay}}};

// Periods for which the laws are designed.
constexpr double kShortestPeriod_s = 0.0005, kLongestPeriod_s = 0.005;

// The scene's choice, unless the command line names a backend.
BackendOptions chosen(const Scene& scene, BackendOptions options) {
  if (options.kind != BackendKind::as_scene || scene.backend.empty()) return options;
  BackendOptions named = backend_named(scene.backend);
  options.kind = named.kind;
  options.type = std::move(named.type);
  return options;
}

// Only the simulation in this process moves the base of a carried arm with its carrier.
void check_carried_arms(const Scene& scene, const BackendOptions& options) {
  const bool mujoco = options.kind == BackendKind::mujoco || options.kind == BackendKind::as_scene;
  if (!mujoco) {
    const std::string name = name_of(options.kind);
    refuse_carried_arms(scene, "the backend '" + (name.empty() ? options.type : name) + "'");
  }
  const auto is_real = [](const SceneArm& arm) { return arm.fci.has_value(); };
  if (!options.addresses.empty() || std::ranges::any_of(scene.arms, is_real))
    refuse_carried_arms(scene, "a run with a real arm");
}

// A log has its own forces. Other backends neither simulate nor read a force sensor.
void check_sensors(Scene& scene, const BackendOptions& options) {
  using enum BackendKind;
  if (options.kind == mujoco || options.kind == fci || options.kind == as_scene) return;
  for (SceneArm& arm : scene.arms) {
    if (arm.force_sensor && options.kind != replay) {
      const std::string name = name_of(options.kind);
      throw std::invalid_argument("arm '" + arm.name + "' has a force sensor, and the backend '" +
                                  (name.empty() ? options.type : name) +
                                  "' has none; use mujoco or fci, or remove 'force_sensor'");
    }
    arm.force_sensor.reset();
  }
}

std::string describe(const Scene& scene) {
  std::string text;
  for (const auto& arm : scene.arms) {
    text += (text.empty() ? "" : ", ") + arm.name + (arm.fci ? " fci " + arm.fci->address : " mujoco");
  }
  return text;
}

// A run without pacing waits for the slowest arm and the disk, without real-time scheduling. An arm with its
// own clock would miss commands meanwhile.
void check_that_arms_wait(const Scene& scene) {
  for (const auto& arm : scene.arms) {
    if (!arm.fci || is_on_this_computer(arm.fci->address)) continue;
    throw std::invalid_argument("arm '" + arm.name + "' is at " + arm.fci->address +
                                ", but a run with --fast cannot control a real arm, which does not wait for "
                                "commands. Omit --fast; virtual arms that wait "
                                "(virtual-arm --pace lockstep) are expected on this computer, at 127.x.y.z");
  }
}

// Real arms through the control interface. The others, if any, are simulated in one world.
std::unique_ptr<Backend> make_real(const Scene& scene, const BackendPace& pace) {
  if (!pace.paced) check_that_arms_wait(scene);
  MixedBackend::Parts parts;
  parts.lockstep = !pace.paced;
  std::vector<fci::FciArmConfig> real;
  Scene simulated = scene;
  std::erase_if(simulated.arms, [](const SceneArm& arm) { return arm.fci.has_value(); });
  for (ArmIndex i = 0; i < scene.arms.size(); ++i) {
    const SceneArm& arm = scene.arms[i];
    if (arm.fci) real.push_back(fci::fci_arm_config(arm, arm.fci->address));
    (arm.fci ? parts.real_arms : parts.simulated_arms).push_back(i);
  }
  parts.real = std::make_unique<fci::FciBackend>(
      std::move(real), fci::FciOptions{.lockstep = !pace.paced, .report = pace.report});
  if (simulated.arms.empty()) return std::move(parts.real);
  parts.simulated = make_simulated(simulated, {.kind = BackendKind::mujoco}, {.paced = false, .report = {}});
  return std::make_unique<MixedBackend>(std::move(parts));
}

std::unique_ptr<Backend> make_replay(const Scene& scene, const BackendOptions& options,
                                     const BackendPace& pace) {
  if (options.log.empty()) throw std::invalid_argument("the backend replay needs a log: add --log LOG");
  std::vector<ReplayBackend::Arm> arms;
  for (const auto& arm : scene.arms) {
    const ArmConfig config = arm_config(arm);
    arms.push_back({.name = arm.name, .frames = config.frames, .tool = config.tool, .load = config.load});
  }
  const auto log = std::filesystem::is_directory(options.log) ? options.log / "log.mcap" : options.log;
  return std::make_unique<ReplayBackend>(log, std::move(arms), pace.paced, pace.report);
}

std::unique_ptr<Backend> make_from_library(const Scene& scene, const Registry& registry,
                                           const std::string& name, const BackendPace& pace) {
  const BackendType* type = registry.backend(name);
  if (type == nullptr) {
    std::vector<std::string> names = backend_names();
    for (const auto& known : registry.backends()) names.push_back(known.name);
    throw std::invalid_argument("there is no backend '" + name + "'" +
                                name_hint(name, names, "there are none") +
                                "; a library's backend needs its library in the scene's 'plugins'");
  }
  BackendSetup setup{.arms = {}, .paced = pace.paced, .report = pace.report};
  for (const auto& arm : scene.arms) {
    if (arm.collision || arm.joint_stiffness || arm.cartesian_stiffness) {
      throw std::invalid_argument("the backend '" + name +
                                  "' comes from a library and cannot set collision " +
                                  "thresholds or stiffnesses; remove these keys of arm '" + arm.name + "'");
    }
    const ArmConfig config = arm_config(arm);
    setup.arms.push_back({.name = arm.name,
                          .model = build_arm_model(arm),
                          .frames = config.frames,
                          .tool = config.tool,
                          .load = config.load,
                          .q_start = arm.q_start});
  }
  auto backend = type->create(setup);
  if (backend == nullptr || backend->arm_count() != scene.arms.size())
    throw std::invalid_argument("the backend '" + name + "' does not have the arms of the scene");
  const double period = backend->period();
  if (!(period >= kShortestPeriod_s && period <= kLongestPeriod_s)) {
    throw std::invalid_argument("the backend '" + name + "' has a period of " + std::to_string(period) +
                                " s; expected 0.0005 to 0.005 s");
  }
  for (ArmIndex arm = 0; arm < backend->arm_count(); ++arm) {
    if (backend->capabilities(arm).compensates_gravity) continue;
    throw std::invalid_argument("the backend '" + name + "' does not compensate the gravity of arm '" +
                                scene.arms[arm].name + "'; torques exclude gravity, so the arm would fall");
  }
  return backend;
}

}  // namespace

std::vector<std::string> backend_names() {
  std::vector<std::string> names;
  for (const auto& known : kBackends) names.emplace_back(known.name);
  return names;
}

std::string name_of(BackendKind kind) {
  const auto known = std::ranges::find_if(kBackends, [&](const auto& each) { return kind == each.kind; });
  return known != kBackends.end() ? known->name : std::string();
}

BackendOptions backend_named(const std::string& name) {
  BackendOptions options;
  if (name.empty()) return options;
  const auto known = std::ranges::find_if(kBackends, [&](const auto& each) { return name == each.name; });
  options.kind = known != kBackends.end() ? known->kind : BackendKind::from_library;
  if (known == kBackends.end()) options.type = name;
  return options;
}

bool is_simulated(const Scene& scene, const BackendOptions& options) {
  return chosen(scene, options).kind != BackendKind::from_library &&
         std::ranges::none_of(with_connections(scene, options).arms,
                              [](const SceneArm& arm) { return arm.fci.has_value(); });
}

Scene with_connections(Scene scene, const BackendOptions& given) {
  const BackendOptions options = chosen(scene, given);
  check_addresses(scene, options);
  check_carried_arms(scene, options);
  check_sensors(scene, options);
  for (ArmIndex i = 0; i < scene.arms.size(); ++i) {
    SceneArm& arm = scene.arms[i];
    if (options.kind != BackendKind::as_scene && options.kind != BackendKind::fci) arm.fci.reset();
    if (options.kind == BackendKind::fci && !arm.fci) {
      arm.fci = FciConnection{.address = "127.0.0." + std::to_string(i + 1), .place = arm.place};
    }
    for (const auto& [name, address] : options.addresses) {
      if (name != arm.name) continue;
      if (!arm.fci) arm.fci.emplace();
      arm.fci->address = address;
    }
  }
  for (std::size_t i = 0; i < scene.arms.size(); ++i) {
    for (std::size_t k = i + 1; k < scene.arms.size(); ++k) {
      if (!scene.arms[i].fci || !scene.arms[k].fci) continue;
      const auto &one = scene.arms[i].force_sensor, &other = scene.arms[k].force_sensor;
      if (one && other && one->address == other->address)
        throw std::invalid_argument("the force sensors of arms '" + scene.arms[i].name + "' and '" +
                                    scene.arms[k].name + "' have the same address " + one->address +
                                    "; every sensor needs its own");
      if (scene.arms[i].fci->address != scene.arms[k].fci->address) continue;
      throw std::invalid_argument("arms '" + scene.arms[i].name + "' and '" + scene.arms[k].name +
                                  "' have the same address " + scene.arms[i].fci->address +
                                  "; every arm needs its own");
    }
  }
  return scene;
}

BackendSet make_backend(const Scene& scene, const Registry& registry, const BackendOptions& given,
                        const BackendPace& pace) {
  const BackendOptions options = chosen(scene, given);
  check_carried_arms(scene, options);
  switch (options.kind) {
    case BackendKind::virtual_arms:
    case BackendKind::pinocchio:
      return {make_simulated(scene, options, pace), name_of(options.kind)};
    case BackendKind::replay:
      return {make_replay(scene, options, pace), "replay of " + options.log.string()};
    case BackendKind::from_library:
      return {make_from_library(scene, registry, options.type, pace), options.type};
    case BackendKind::as_scene:
    case BackendKind::mujoco:
    case BackendKind::fci:
      break;
  }
  if (std::ranges::any_of(scene.arms, [](const auto& arm) { return arm.fci.has_value(); }))
    return {make_real(scene, pace), describe(scene)};
  return {make_simulated(scene, options, pace), "mujoco"};
}

}  // namespace multipanda
