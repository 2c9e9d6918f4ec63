#pragma once

#include <optional>

#include "doctor/finding.hpp"
#include "doctor/load.hpp"
#include "doctor/system_files.hpp"

namespace multipanda::doctor {

// Whether ROS 2 is on, and what its discovery and topics send to everybody on the network.
struct DdsReading {
  std::vector<int> domains;                           // whose discovery port is bound on this computer
  std::string middleware, domain;                     // RMW_IMPLEMENTATION, ROS_DOMAIN_ID; empty: not set
  std::optional<double> multicast_in, multicast_out;  // packets per second, of all kinds
};
DdsReading read_dds(const LoadSample& before, const LoadSample& after, const SystemFiles& files);

Finding judge_dds(const DdsReading& reading, Purpose purpose);

}  // namespace multipanda::doctor
