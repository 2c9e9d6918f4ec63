#pragma once

#include <memory>

#include "runtime/backends.hpp"

namespace multipanda {

// Whether this program has simulators: one for arms alone links not_simulated.cpp in place of simulated.cpp.
bool has_simulators();

// The backend of a scene whose arms are all simulated, by the kind in the options: `virtual_arms`,
// `pinocchio`, otherwise MuJoCo. Throws std::invalid_argument as make_backend(), and without simulators.
std::unique_ptr<Backend> make_simulated(const Scene& scene, const BackendOptions& options,
                                        const BackendPace& pace);

}  // namespace multipanda
