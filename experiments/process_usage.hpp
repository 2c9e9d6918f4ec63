#pragma once

#include <cstdint>
#include <sys/types.h>

// What processes use of the machine, from /proc. Off the loop.
namespace multipanda {

// Totals so far; differences of two readings over the time between them give the load.
struct ProcessUsage {
  bool present = false;  // false: the process is gone (or /proc cannot be read)
  double cpu_s = 0;      // of all its threads [core seconds]
  double memory_mb = 0;  // resident, as `top` shows it (RES)
};
ProcessUsage process_usage(pid_t process);

// Of one thread of this process.
struct ThreadUsage {
  double cpu_s = 0;
  double waited_s = 0;  // ready to run, but another one had the core
};
ThreadUsage thread_usage(pid_t thread);

struct MachineUsage {
  double busy_s = 0;  // of all cores, by everybody [core seconds]
  double load_1min = 0;
};
MachineUsage machine_usage();

double machine_memory_mb();

}  // namespace multipanda
