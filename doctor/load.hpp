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

// Between two samples.
struct LoadReading {
  std::vector<double> cores;    // share of the time each was busy, 0 to 1
  std::optional<double> steal;  // share that the host of a virtual machine took, of all cores
  struct Process {
    int number = 0;
    std::string name;
    double cores = 0;  // how many it kept busy
  };
  std::vector<Process> processes;       // others than this one, most first; at least 1 % of a core
  std::vector<int> isolated, tickless;  // cores that the scheduler leaves alone; without regular ticks
};
LoadReading load_between(const LoadSample& before, const LoadSample& after, const SystemFiles& files);

Finding judge_load(const LoadReading& reading, Purpose purpose);
Finding judge_isolation(const LoadReading& reading, Purpose purpose);
Finding judge_steal(const LoadReading& reading, Purpose purpose);

}  // namespace multipanda::doctor
