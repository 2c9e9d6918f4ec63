#pragma once

#include <map>
#include <optional>

#include "doctor/finding.hpp"
#include "doctor/system_files.hpp"

namespace multipanda::doctor {

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

}  // namespace multipanda::doctor
