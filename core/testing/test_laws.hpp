#pragma once

#include "core/modes/registry.hpp"

namespace multipanda::test {

// A registry for tests of modes and faults, with these controllets:
// - spring: 1 arm, no inputs; tau = -2 dq + 3 (q_start - q) + 0.01 t, so that a restart is visible.
// - pair: 2 arms, the same law on both.
// - follow: 1 arm, input "joints"; tau = 20 (q_d - q) - 2 dq.
// - broken: 1 arm; parameter "fault": 0 spring, 1 NaN, 2 infinity, 3 implausible, 4 throws, 5 reports a
// fault,
//   6 resizes the torque vector.
// - refuser: 1 arm; start() refuses.
// - thrower: 1 arm; start() throws.
// Its feature "push" adds its parameter "torque_nm" to every joint; 99 adds NaN, -99 throws.
Registry test_registry();

}  // namespace multipanda::test
