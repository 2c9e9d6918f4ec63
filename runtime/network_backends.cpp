#include "runtime/network_backends.hpp"

#include <algorithm>

#include "fci/client/fci_backend.hpp"
#include "fci/client/from_scene.hpp"
#include "runtime/mixed_backend.hpp"
#include "runtime/virtual_backend.hpp"

namespace multipanda {
namespace {

fci::FciArmConfig arm_of(const SceneArm& arm) { return fci::fci_arm_config(arm, arm.fci->address); }

fci::FciOptions fci_options(const BackendPace& pace) { return {.lockstep = !pace.paced, .say = pace.say}; }

std::string describe(const Scene& scene) {
  std::string text;
  for (const auto& arm : scene.arms) {
    text += (text.empty() ? "" : ", ") + arm.name + (arm.fci ? " fci " + arm.fci->address : " mujoco");
  }
  return text;
}

BackendSet virtual_set(const Scene& scene, const BackendPace& pace) {
  const VirtualPace clock = !pace.paced     ? VirtualPace::unpaced
                            : pace.lockstep ? VirtualPace::waiting
                                            : VirtualPace::realtime;
  auto backend = std::make_unique<VirtualBackend>(scene, clock, pace.say);
  const VirtualBackend* links = backend.get();
  return {.backend = std::move(backend),
          .link = [links](ArmIndex arm) { return std::optional(links->statistics(arm)); },
          .description = "virtual"};
}

BackendSet real_set(const Scene& scene, const BackendPace& pace) {
  std::vector<fci::FciArmConfig> configs;
  for (const auto& arm : scene.arms) configs.push_back(arm_of(arm));
  auto backend = std::make_unique<fci::FciBackend>(std::move(configs), fci_options(pace));
  const fci::FciBackend* links = backend.get();
  return {.backend = std::move(backend),
          .link = [links](ArmIndex arm) { return std::optional(links->statistics(arm)); },
          .description = describe(scene)};
}

// The simulated arms alone, in the same world.
Scene simulated_part(Scene scene) {
  std::erase_if(scene.arms, [](const SceneArm& arm) { return arm.fci.has_value(); });
  return scene;
}

BackendSet mixed_set(const Scene& scene, const BackendPace& pace) {
  MixedBackend::Parts parts;
  parts.lockstep = !pace.paced;
  std::vector<fci::FciArmConfig> real;
  std::vector<std::optional<ArmIndex>> link_of;
  for (ArmIndex i = 0; i < scene.arms.size(); ++i) {
    if (scene.arms[i].fci) {
      link_of.emplace_back(real.size());
      real.push_back(arm_of(scene.arms[i]));
      parts.real_arms.push_back(i);
    } else {
      link_of.emplace_back();
      parts.simulated_arms.push_back(i);
    }
  }
  parts.real = std::make_unique<fci::FciBackend>(std::move(real), fci_options(pace));
  parts.simulated =
      std::make_unique<MujocoBackend>(simulated_part(scene), MujocoOptions{.pace = Pace::unpaced});
  const fci::FciBackend* links = parts.real.get();
  const auto link = [links, link_of](ArmIndex arm) -> std::optional<fci::ArmStatistics> {
    if (!link_of.at(arm)) return std::nullopt;
    return links->statistics(*link_of[arm]);
  };
  return {.backend = std::make_unique<MixedBackend>(std::move(parts)),
          .link = link,
          .description = describe(scene)};
}

}  // namespace

BackendSet make_network_backend(const Scene& scene, ArmsFrom arms, const BackendPace& pace) {
  if (arms == ArmsFrom::virtual_arms) return virtual_set(scene, pace);
  const bool all =
      std::all_of(scene.arms.begin(), scene.arms.end(), [](const auto& arm) { return arm.fci.has_value(); });
  return all ? real_set(scene, pace) : mixed_set(scene, pace);
}

}  // namespace multipanda
