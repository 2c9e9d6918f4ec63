#pragma once

#include <optional>

#include "doctor/finding.hpp"
#include "doctor/system_files.hpp"

namespace multipanda::doctor {

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

}  // namespace multipanda::doctor
