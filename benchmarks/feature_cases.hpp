#pragma once

#include <map>
#include <string>
#include <vector>

#include "benchmarks/figures.hpp"
#include "core/modes/registry.hpp"

namespace multipanda::bench {

// What features cost where they act: "features_us/none", "features_us/collision_avoidance", ... each one
// whole ControlCycle::step of DC over two arms whose hands nearly meet, above a floor. At every state at
// least three pairs of shapes are nearer than 0.05 m, and the manipulability of both arms is below 0.1:
// checked, throws std::runtime_error otherwise.
std::vector<Case> feature_cases(const Registry& registry, const Filter& wanted);

// Heap and lock calls of 10,000 such steps, by the same names without the section.
struct LoopCalls {
  std::uint64_t heap = 0, locks = 0;
};
std::map<std::string, LoopCalls> count_feature_calls(const Registry& registry, const Filter& wanted);

}  // namespace multipanda::bench
