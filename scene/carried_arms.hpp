#pragma once

#include <string>

#include "scene/scene.hpp"

namespace multipanda {

// The first arm of a scene that stands on another arm (key `base_on`), or nullptr.
const SceneArm* carried_arm(const Scene& scene);

struct CarriedArmRefused : ConfigError {
  using ConfigError::ConfigError;
};

// For all that takes every base to stand still. `what` is the subject of the message: "commission", "the
// cockpit". Throws CarriedArmRefused at the key `base_on` if there is a carried arm.
void refuse_carried_arms(const Scene& scene, const std::string& what);

}  // namespace multipanda
