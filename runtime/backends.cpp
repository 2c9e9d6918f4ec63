#include "runtime/backends.hpp"

#include <algorithm>
#include <stdexcept>

#include "backends/mujoco/mujoco_backend.hpp"
#include "runtime/network_backends.hpp"
#include "scene/names.hpp"

namespace multipanda {
namespace {

void check_addresses(const Scene& scene, const BackendOptions& options) {
  std::vector<std::string> names;
  for (const auto& arm : scene.arms) names.push_back(arm.name);
  for (const auto& [name, address] : options.addresses) {
    if (std::find(names.begin(), names.end(), name) == names.end()) {
      throw std::invalid_argument("an address is given for arm '" + name +
                                  "', which the scene does not have" +
                                  name_hint(name, names, "there are none"));
    }
    if (options.arms == ArmsFrom::mujoco || options.arms == ArmsFrom::virtual_arms) {
      throw std::invalid_argument(
          "an address is given for arm '" + name +
          "', but all arms of this run are simulated; leave it out, or say --backend fci");
    }
  }
}

}  // namespace

std::string_view name_of(ArmsFrom arms) {
  switch (arms) {
    case ArmsFrom::scene:
      return "scene";
    case ArmsFrom::mujoco:
      return "mujoco";
    case ArmsFrom::fci:
      return "fci";
    case ArmsFrom::virtual_arms:
      return "virtual";
  }
  return "";
}

Scene with_arms_from(Scene scene, const BackendOptions& options) {
  check_addresses(scene, options);
  for (ArmIndex i = 0; i < scene.arms.size(); ++i) {
    SceneArm& arm = scene.arms[i];
    if (options.arms == ArmsFrom::mujoco || options.arms == ArmsFrom::virtual_arms) arm.fci.reset();
    if (options.arms == ArmsFrom::fci && !arm.fci) {
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
      if (!scene.arms[i].fci || !scene.arms[k].fci ||
          scene.arms[i].fci->address != scene.arms[k].fci->address)
        continue;
      throw std::invalid_argument("arms '" + scene.arms[i].name + "' and '" + scene.arms[k].name +
                                  "' have the same address " + scene.arms[i].fci->address +
                                  "; every arm has its own");
    }
  }
  return scene;
}

BackendSet make_backend(const Scene& scene, ArmsFrom arms, const BackendPace& pace) {
  const bool none_real =
      std::none_of(scene.arms.begin(), scene.arms.end(), [](const auto& arm) { return arm.fci.has_value(); });
  if (none_real && arms != ArmsFrom::virtual_arms) {
    const Pace clock = pace.paced ? Pace::realtime : Pace::unpaced;
    return {.backend = std::make_unique<MujocoBackend>(scene, MujocoOptions{.pace = clock}),
            .link = [](ArmIndex) { return std::optional<fci::ArmStatistics>(); },
            .description = "mujoco"};
  }
  return make_network_backend(scene, arms, pace);
}

}  // namespace multipanda
