#pragma once

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

}  // namespace multipanda::doctor
