#pragma once

#include "runtime/backends.hpp"

namespace multipanda {

// make_backend() for scenes with arms that are reached over the network: real ones, real beside simulated
// ones, or virtual ones of this process.
BackendSet make_network_backend(const Scene& scene, ArmsFrom arms, const BackendPace& pace);

}  // namespace multipanda
