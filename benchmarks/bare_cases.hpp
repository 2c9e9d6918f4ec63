#pragma once

#include <vector>

#include "benchmarks/figures.hpp"
#include "benchmarks/loops.hpp"

namespace multipanda::bench {

// The libraries alone, over the same states as the control cycle: "limits_us/pinocchio_terms",
// "limits_us/dual_cartesian_impedance", "limits_us/mj_step/<arms>".
// Throws std::runtime_error if the bare two-arm maths gives other torques than the controllet (by more than
// 1e-9 N m): then the two do not compute the same, and comparing their times means nothing.
std::vector<Case> bare_cases(const Arms& arms, const Registry& registry, const Filter& wanted);

}  // namespace multipanda::bench
