#pragma once

#include <cstdint>
#include <map>
#include <optional>

#include "doctor/finding.hpp"

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

// Counters of the kernel at one time.
struct LoadSample {
  struct Core {
    double busy = 0, steal = 0, total = 0;  // [ticks]
  };
  std::vector<Core> cores;
  struct Process {
    std::string name;
    double ticks = 0;
  };
  std::map<int, Process> processes;                   // by number
  std::optional<double> multicast_in, multicast_out;  // packets
  double time_s = 0;                                  // of this computer's clock
};
LoadSample sample_load(const SystemFiles& files);

// Difference between two samples.
struct LoadReading {
  std::vector<double> cores;    // busy fraction of each core, 0 to 1
  std::optional<double> steal;  // fraction of all cores that the host of a virtual machine took
  struct Process {
    int number = 0;
    std::string name;
    double cores = 0;  // number of cores that it kept busy
  };
  std::vector<Process> processes;       // other processes with at least 1 % of a core, busiest first
  std::vector<int> isolated, tickless;  // cores excluded from scheduling; cores without regular ticks
};
LoadReading load_between(const LoadSample& before, const LoadSample& after, const SystemFiles& files);

Finding judge_load(const LoadReading& reading, Purpose purpose);
Finding judge_isolation(const LoadReading& reading, Purpose purpose);
Finding judge_steal(const LoadReading& reading, Purpose purpose);

// Whether ROS 2 is running, and its multicast traffic.
struct DdsReading {
  std::vector<int> domains;        // domains whose discovery port is bound on this computer
  std::string middleware, domain;  // RMW_IMPLEMENTATION, ROS_DOMAIN_ID; empty: not set
  std::optional<double> multicast_in, multicast_out;  // all multicast packets per second
};
DdsReading read_dds(const LoadSample& before, const LoadSample& after, const SystemFiles& files);

Finding judge_dds(const DdsReading& reading, Purpose purpose);

}  // namespace multipanda::doctor
