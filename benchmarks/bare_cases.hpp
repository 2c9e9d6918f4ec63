#pragma once

#include <vector>

#include "benchmarks/figures.hpp"
#include "benchmarks/loops.hpp"

namespace multipanda::bench {

// The libraries alone, over the same states as the control cycle: "limits_us/pinocchio_terms",
// "limits_us/dual_cartesian_impedance", "limits_us/mj_step/<arms>".
// Throws std::runtime_error if the torques of the bare two-arm math and of the controllet differ by more
// than 1e-9 N m, because their times could not be compared.
std::vector<Case> bare_cases(const Arms& arms, const Registry& registry, const Filter& selected);

}  // namespace multipanda::bench
