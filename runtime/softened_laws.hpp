#pragma once

#include <string>
#include <vector>

#include "core/modes/registry.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// Laws soften stiffnesses that an arm cannot bear (core/controllets/damping_design.hpp; their output
// `stiffness_share`). The controllets that have less than half of their requested stiffness where the scene
// begins, one sentence each: the controllet, its arms, the gains, the share, and what to do.
std::vector<std::string> softened_laws(const Scene& scene, const Registry& registry);

}  // namespace multipanda
