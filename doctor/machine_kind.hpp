#pragma once

#include <optional>

#include "doctor/finding.hpp"
#include "doctor/system_files.hpp"

namespace multipanda::doctor {

// What kind of computer this is: real, virtual, a container; and by what it tells the time.
struct MachineKindReading {
  std::string processor;
  int cores = 0;
  std::optional<bool> hypervisor;  // the processor says that it is virtual
  std::string product;             // of the maker of the (virtual) machine; empty: closed
  bool container = false;
  std::string clock_source;  // empty: cannot be read
  double clock_read_ns = 0;  // what reading the clock costs
};
MachineKindReading read_machine_kind(const SystemFiles& files);

Finding judge_virtual_machine(const MachineKindReading& reading, Purpose purpose);
Finding judge_clock_source(const MachineKindReading& reading, Purpose purpose);

}  // namespace multipanda::doctor
