#pragma once

#include <cstdint>
#include <map>
#include <optional>

#include "doctor/finding.hpp"
#include "doctor/system_files.hpp"

namespace multipanda::doctor {

struct KernelReading {
  std::string release, version;      // of uname
  std::optional<int> realtime_flag;  // /sys/kernel/realtime: 1 with PREEMPT_RT; absent without
};
KernelReading read_kernel(const SystemFiles& files);

// The kernel, and whether it can be preempted for the loop at any time.
Finding judge_kernel(const KernelReading& reading, Purpose purpose);

// Kind of computer (physical, virtual, container) and its clock.
struct MachineKindReading {
  std::string processor;
  int cores = 0;
  std::optional<bool> hypervisor;  // reported by the processor
  std::string product;             // product name of the (virtual) machine; empty: not readable
  bool container = false;
  std::string clock_source;  // empty: cannot be read
  double clock_read_ns = 0;  // time to read the clock
};
MachineKindReading read_machine_kind(const SystemFiles& files);

Finding judge_virtual_machine(const MachineKindReading& reading, Purpose purpose);
Finding judge_clock_source(const MachineKindReading& reading, Purpose purpose);

// Power saving of the processor; empty if the kernel does not report it (as in virtual machines).
struct ProcessorReading {
  std::map<std::string, int> governors;            // cores per governor
  std::optional<double> slowest_mhz, fastest_mhz;  // of the cores, now
  std::optional<double> max_mhz;                   // largest frequency of the hardware
  std::optional<bool> turbo;                       // may exceed its nominal frequency
  struct IdleState {
    std::string name;
    double latency_us = 0;  // time to wake up from it
    bool enabled = true;
  };
  std::vector<IdleState> idle_states;  // of core 0
};
ProcessorReading read_processor(const SystemFiles& files);

Finding judge_governor(const ProcessorReading& reading, Purpose purpose);
Finding judge_idle_states(const ProcessorReading& reading, Purpose purpose);

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
