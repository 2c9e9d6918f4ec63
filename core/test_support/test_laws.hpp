#pragma once

#include "core/modes/registry.hpp"

namespace multipanda::test {

// A registry of its own for tests of modes and faults:
//   spring    1 arm, inputs none: tau = -2 dq + 3 (q_start - q) + 0.01 t, so that a restart shows in the
//   torque pair      2 arms, the same law on both follow    1 arm, input "joints"; tau = 20 (q_d - q) - 2 dq
//   saboteur  1 arm; parameter "fault": 0 spring, 1 NaN, 2 infinity, 3 absurd, 4 throws, 5 reports a fault,
//             6 leaves a vector of the wrong size
//   refuser   1 arm; start() refuses
//   thrower   1 arm; start() throws
//   and the feature "push": adds its parameter "torque_nm" to every joint; 99 there: NaN
Registry test_registry();

}  // namespace multipanda::test
