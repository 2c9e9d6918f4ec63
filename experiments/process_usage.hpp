#pragma once

#include <cstdint>
#include <sys/types.h>

// CPU and memory usage of processes, from /proc. Not for the loop.
namespace multipanda {

// Totals since the start. The difference of two readings over the time between them is the load.
struct ProcessUsage {
  bool present = false;  // false: the process is gone (or /proc cannot be read)
  double cpu_s = 0;      // of all its threads [core seconds]
  double memory_mb = 0;  // resident, as `top` shows it (RES)
};
ProcessUsage process_usage(pid_t process);

// Usage of one thread of this process.
struct ThreadUsage {
  double cpu_s = 0;
  double waited_s = 0;  // ready to run while another thread had the core
};
ThreadUsage thread_usage(pid_t thread);

struct MachineUsage {
  double busy_s = 0;  // of all cores and processes [core seconds]
  double load_1min = 0;
};
MachineUsage machine_usage();

double machine_memory_mb();

}  // namespace multipanda
