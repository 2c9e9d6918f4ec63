#pragma once

#include <cstdint>

#include "core/types/arm_set.hpp"
#include "core/types/time.hpp"

namespace multipanda {

// One step of the loop.
struct Tick {
  std::uint64_t cycle = 0;
  LoopTime t;      // simulated time in lock-step, else host time since the start
  double dt = 0;   // since the step before [s]
  ArmSet due;      // arms whose packet arrived: they get a torque in this step
  HostTime start;  // when the step began
};

}  // namespace multipanda
