#pragma once

#include <optional>
#include <string>
#include <vector>

#include "benchmarks/figures.hpp"
#include "core/modes/registry.hpp"

namespace multipanda::bench {

struct RosTimes {
  std::vector<double> switch_ms;            // one per trial
  std::vector<double> adapter_us;           // one per cycle: the adapter's time in the loop's thread
  std::vector<double> with_us, without_us;  // cycle times of the run with the adapter and of one without
  std::string missing;                      // reason if there are no results: not built, ...
};

// Runs two simulated arms (the scene two_arms) at 1 kHz with the ROS adapter. A client process switches by
// the service ~/switch_controllets at seeded random moments, alternating between two Cartesian impedances
// and DC. A trial lasts from just before the client sends the request until the loop has written the first
// torque of the new controllets, both on this computer's steady clock. Cycle times come
// from three runs with the adapter and three without, in turns.
RosTimes measure_ros(const Registry& registry, std::size_t trials);

}  // namespace multipanda::bench
