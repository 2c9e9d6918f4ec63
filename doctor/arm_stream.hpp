#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "doctor/distribution.hpp"
#include "doctor/finding.hpp"

namespace multipanda::doctor {

// The state of an arm's control interface, read without commands.
struct ArmStreamReading {
  std::string address;
  std::string reason;                                   // why there is no connection; empty: connected
  int version = 0;                                      // agreed version of the protocol
  std::string mode;                                     // "idle", "reflex", ...
  std::string errors;                                   // names of active errors; empty: none
  double seconds = 0;                                   // duration of listening
  std::uint64_t states = 0, lost = 0, lost_in_row = 0;  // by the arm's sequence numbers
  // Some of those lost did arrive, but this computer woke so late that a newer one was there, too.
  std::uint64_t outdated = 0;
  std::vector<double> gaps_us;  // between the arrivals of two states
};
// Connects, listens and closes, without any command. The control interface serves one program at a time, so
// no other program can be connected meanwhile.
ArmStreamReading read_arm_stream(const std::string& address, double seconds);

Finding judge_arm_version(const ArmStreamReading& reading, Purpose purpose);
Finding judge_state_stream(const ArmStreamReading& reading, Purpose purpose);

// "Franka Research 3, system 5.9 or later": the arms that use a version of the protocol.
std::string arms_of_version(int version);

}  // namespace multipanda::doctor
