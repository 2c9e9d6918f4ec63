#pragma once

#include <cstdint>
#include <optional>

#include "doctor/finding.hpp"
#include "doctor/system_files.hpp"

namespace multipanda::doctor {

// Scheduling and memory rights of this user.
struct SchedulingReading {
  int priority = 80;                 // that the loop requests
  bool fifo = false;                 // granted in a trial
  int fifo_error = 0;                // errno if refused
  std::uint64_t priority_limit = 0;  // RLIMIT_RTPRIO
  bool superuser = false;
  bool memory_locks = false;             // granted in a trial
  bool memory_unlimited = false;         // RLIMIT_MEMLOCK, or the right to ignore it
  std::uint64_t memory_limit_bytes = 0;  // RLIMIT_MEMLOCK
  // Real-time threads may use `runtime` of each `period`; -1: no limit.
  std::optional<double> rt_runtime_us, rt_period_us;
};
// Tries SCHED_FIFO on a separate thread, and locks memory for a moment.
SchedulingReading read_scheduling(const SystemFiles& files);

Finding judge_fifo(const SchedulingReading& reading, Purpose purpose);
Finding judge_memory_lock(const SchedulingReading& reading, Purpose purpose);
Finding judge_throttling(const SchedulingReading& reading, Purpose purpose);

}  // namespace multipanda::doctor
