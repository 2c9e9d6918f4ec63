#pragma once

#include <vector>

#include "benchmarks/figures.hpp"
#include "benchmarks/loops.hpp"

namespace multipanda::bench {

// One whole ControlCycle::step over SmoothMotion per call. "cycle_us/<controllet>/<arms>" for every
// registered controllet and every suitable number of arms, each arm or pair under its own instance;
// "cycle_us/<controllet>+<feature>/2" for every registered feature.
std::vector<Case> cycle_cases(const Arms& arms, const Registry& registry, const Filter& selected);

struct RealtimeFactor {
  std::string name;   // "2"; "2+features": with collision avoidance and manipulability
  double factor = 0;  // simulated time over wall-clock time, median of the chunks
};
// `chunks` chunks of `cycles` control cycles each, in alternation. Ends after a complete round once
// `budget_s` is over.
std::vector<RealtimeFactor> measure_realtime_factor(const Registry& registry, std::size_t chunks,
                                                    std::size_t cycles, double budget_s,
                                                    const Filter& selected);

}  // namespace multipanda::bench
