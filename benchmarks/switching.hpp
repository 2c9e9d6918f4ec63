#pragma once

#include <map>
#include <string>
#include <vector>

#include "benchmarks/figures.hpp"
#include "benchmarks/loops.hpp"
#include "core/rt/thread_setup.hpp"

namespace multipanda::bench {

struct SwitchTimes {
  std::map<std::string, std::vector<double>> trials_ms;  // "controllet", "feature"
  std::vector<SetupStep> loop_thread;                    // what the loop's thread was given
};

// Two arms in a loop of their own thread at 1 kHz. Another thread asks at random moments, seeded: for two
// Cartesian impedances or DC in turn, and for joint_limits on or off. A trial lasts from just before the
// request is sent to just after the first torque of what it asked for was written.
// Throws std::runtime_error if a request is refused or not answered within a second.
SwitchTimes measure_switching(const Arms& arms, const Registry& registry, std::size_t trials,
                              const Filter& wanted);

}  // namespace multipanda::bench
