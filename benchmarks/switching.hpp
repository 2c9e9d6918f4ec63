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
  std::vector<SetupStep> loop_thread;                    // scheduling granted to the loop's thread
};

// Runs two arms at 1 kHz in a separate thread. Another thread sends requests at random moments, seeded: for
// two Cartesian impedances and DC alternately, and for joint_limits on and off. A trial lasts from just
// before the request is sent until just after its first torque is written. Throws std::runtime_error if a
// request is refused or not answered within a second.
SwitchTimes measure_switching(const Arms& arms, const Registry& registry, std::size_t trials,
                              const Filter& selected);

}  // namespace multipanda::bench
