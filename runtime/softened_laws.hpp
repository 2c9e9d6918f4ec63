#pragma once

#include <string>
#include <vector>

#include "core/modes/registry.hpp"
#include "scene/scene.hpp"

namespace multipanda {

// Laws soften what an arm does not bear (core/controllets/damping_design.hpp), by their output
// `stiffness_share`. Which controllets of the scene have less than half of what they ask for where the scene
// begins, one sentence each: the controllet, its arms, the gains, the share, and what to do.
std::vector<std::string> softened_laws(const Scene& scene, const Registry& registry);

}  // namespace multipanda
