#pragma once

#include <cstdint>

#include "core/types/arm_set.hpp"
#include "core/types/time.hpp"

namespace multipanda {

// One cycle of the loop.
struct Tick {
  std::uint64_t cycle = 0;
  LoopTime t;                  // simulated time in lock-step, otherwise host time since the start
  double dt = 0;               // since the previous step [s]
  double period = kArmPeriod;  // the nominal time between two steps [s]
  ArmSet due;                  // arms whose packet arrived; they receive a torque in this step
  HostTime start;              // when the step began
};

}  // namespace multipanda
