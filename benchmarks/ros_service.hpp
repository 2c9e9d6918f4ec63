#pragma once

#include <optional>
#include <string>
#include <vector>

#include "benchmarks/figures.hpp"
#include "core/modes/registry.hpp"

namespace multipanda::bench {

struct RosTimes {
  std::vector<double> switch_ms;   // one per trial
  std::vector<double> adapter_us;  // of the loop's thread, one per cycle: what the adapter does there
  std::vector<double> with_us, without_us;  // control cycles of the run with the adapter and of one without
  std::string missing;                      // why there is nothing: not built, ...
};

// Two simulated arms (the scene two_arms) at 1 kHz with the ROS adapter; a client process of its own switches
// by the service ~/switch_controllets at random moments, seeded: two Cartesian impedances or DC in turn. A
// trial lasts from just before the request is sent in the client until the first torque of the new
// controllets was written in the loop: both on this computer's steady clock. Then the same run without an
// adapter.
RosTimes measure_ros(const Registry& registry, std::size_t trials);

}  // namespace multipanda::bench
