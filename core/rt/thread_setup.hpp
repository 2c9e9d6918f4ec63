#pragma once

#include <optional>
#include <string>
#include <vector>

// Asking the operating system for real-time treatment of the loop's thread. Nothing here is fatal by itself:
// each step answers what became of it and why, and the caller decides (in simulation: report and go on).
namespace multipanda {

struct ThreadSetup {
  bool lock_memory = true;  // no page of the process is ever swapped or first touched in the loop
  std::optional<int> fifo_priority =
      80;                  // SCHED_FIFO 1..99; none for unpaced runs, which would starve the machine
  std::optional<int> cpu;  // pin to this core
};

struct SetupStep {
  std::string what;  // "memory lock", "SCHED_FIFO 80", "affinity to core 1"
  bool done = false;
  std::string reason;  // when not done: why, and what to do about it
};

// Applies `setup` to the calling thread (memory lock: to the process), prefaults its stack. Call before the
// loop.
std::vector<SetupStep> set_up_thread(const ThreadSetup& setup);

}  // namespace multipanda
