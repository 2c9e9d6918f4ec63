#pragma once

#include <optional>
#include <string>
#include <vector>

// Requests real-time scheduling for the loop's thread from the operating system. No failure is fatal: each
// step returns its result and the reason, and the caller decides. A simulation reports it and continues.
namespace multipanda {

struct ThreadSetup {
  bool lock_memory = true;  // no page of the process is swapped out or first touched in the loop
  std::optional<int> fifo_priority =
      80;                  // SCHED_FIFO 1 to 99; none for unpaced runs, which would starve the machine
  std::optional<int> cpu;  // pin to this core
};

struct SetupStep {
  std::string what;  // "memory lock", "SCHED_FIFO 80", "affinity to core 1"
  bool done = false;
  std::string reason;  // if it failed: the cause and the remedy
};

// Applies `setup` to the calling thread (the memory lock to the process) and prefaults its stack. Call it
// before the loop. Threads that the calling one starts later inherit the core, not the scheduling.
std::vector<SetupStep> set_up_thread(const ThreadSetup& setup);

}  // namespace multipanda
