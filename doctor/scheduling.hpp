#pragma once

#include <cstdint>
#include <optional>

#include "doctor/finding.hpp"
#include "doctor/system_files.hpp"

namespace multipanda::doctor {

// What the operating system lets this user ask for.
struct SchedulingReading {
  int priority = 80;                 // that the loop asks for
  bool fifo = false;                 // was given when tried
  int fifo_error = 0;                // errno when not
  std::uint64_t priority_limit = 0;  // RLIMIT_RTPRIO
  bool superuser = false;
  bool memory_locks = false;             // was given when tried
  bool memory_unlimited = false;         // RLIMIT_MEMLOCK, or the right to ignore it
  std::uint64_t memory_limit_bytes = 0;  // RLIMIT_MEMLOCK
  // Real-time threads may use runtime of each period; runtime -1: all of it.
  std::optional<double> rt_runtime_us, rt_period_us;
};
// Tries SCHED_FIFO on a thread of its own, and locking memory for a moment.
SchedulingReading read_scheduling(const SystemFiles& files);

Finding judge_fifo(const SchedulingReading& reading, Purpose purpose);
Finding judge_memory_lock(const SchedulingReading& reading, Purpose purpose);
Finding judge_throttling(const SchedulingReading& reading, Purpose purpose);

}  // namespace multipanda::doctor
