#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "doctor/distribution.hpp"
#include "doctor/finding.hpp"

namespace multipanda::doctor {

// One arm as its control interface shows it to somebody who only listens.
struct ArmStreamReading {
  std::string address;
  std::string reason;                                   // why there is no connection; empty: there was one
  int version = 0;                                      // of the protocol, as agreed
  std::string mode;                                     // "idle", "reflex", ...
  std::string errors;                                   // active: names; empty: none
  double seconds = 0;                                   // that were listened
  std::uint64_t states = 0, lost = 0, lost_in_row = 0;  // by the arm's own count
  std::vector<double> gaps_us;                          // between two states' arrival
};
// Connects, listens, closes; sends no command. The control interface serves one program at a time: while this
// one is connected, no other can be, and the other way round.
ArmStreamReading read_arm_stream(const std::string& address, double seconds);

Finding judge_arm_version(const ArmStreamReading& reading, Purpose purpose);
Finding judge_state_stream(const ArmStreamReading& reading, Purpose purpose);

// "Franka Research 3, system 5.9 or later": the arms that speak a version of the protocol.
std::string arms_of_version(int version);

}  // namespace multipanda::doctor
