#pragma once

#include <cstdint>
#include <map>
#include <optional>

#include "doctor/finding.hpp"
#include "doctor/system_files.hpp"

namespace multipanda::doctor {

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
