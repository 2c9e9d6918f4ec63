#pragma once

#include <map>
#include <string>
#include <vector>

#include "benchmarks/figures.hpp"
#include "core/modes/registry.hpp"

namespace multipanda::bench {

// The cost of features where they act: "features_us/none", "features_us/collision_avoidance", ... each one
// whole ControlCycle::step of DC over two arms whose hands nearly meet, above a floor. At every state at
// least three pairs of shapes are nearer than 0.05 m, and the manipulability of both arms is below 0.1;
// throws std::runtime_error otherwise. "collision_avoidance+hulls": both bases have six hulls of 32 corners,
// whose distances from most links have to be computed.
std::vector<Case> feature_cases(const Registry& registry, const Filter& selected);

// Heap and lock calls in 10,000 such steps, with the same names without the section.
struct LoopCalls {
  std::uint64_t heap = 0, locks = 0;
};
std::map<std::string, LoopCalls> count_feature_calls(const Registry& registry, const Filter& selected);

}  // namespace multipanda::bench
