#pragma once

#include <memory>
#include <vector>

#include "core/model/arm_model.hpp"

namespace multipanda {

// Median time of the law of dual_cartesian_impedance for two arms, written directly with Pinocchio and Eigen
// and nothing around it (benchmarks/bare/bare_libraries.hpp): the yardstick of a control cycle. It is
// evaluated once per millisecond, as in a cycle, so that caches are as cold and the clock rate as low as
// there [us]. NaN unless there are two arms of seven joints. The calling thread sleeps between evaluations:
// 0.3 s.
double bare_math_us(const std::vector<std::shared_ptr<const ArmModel>>& models);

}  // namespace multipanda
