#pragma once

#include <optional>

#include "doctor/finding.hpp"
#include "doctor/load.hpp"
#include "doctor/system_files.hpp"

namespace multipanda::doctor {

// Whether ROS 2 is running, and its multicast traffic.
struct DdsReading {
  std::vector<int> domains;        // domains whose discovery port is bound on this computer
  std::string middleware, domain;  // RMW_IMPLEMENTATION, ROS_DOMAIN_ID; empty: not set
  std::optional<double> multicast_in, multicast_out;  // all multicast packets per second
};
DdsReading read_dds(const LoadSample& before, const LoadSample& after, const SystemFiles& files);

Finding judge_dds(const DdsReading& reading, Purpose purpose);

}  // namespace multipanda::doctor
