#pragma once

#include "doctor/distribution.hpp"
#include "doctor/finding.hpp"

namespace multipanda::doctor {

// How long a packet needs to the arm's control unit and back, without asking the arm for anything.
struct RoundTripReading {
  std::string address;
  std::string method;  // "ICMP echo of 1200 bytes"; empty: none was possible
  std::string reason;  // why not
  std::vector<double> us;
  std::size_t sent = 0;
};
// Echo requests at 1 kHz for `seconds`, of the size of the arm's packets, where this user may send them; else
// the time to open a connection to the control port, some ten times.
RoundTripReading read_round_trip(const std::string& address, double seconds);

// The maker's limit of the round trip.
inline constexpr double kRoundTripLimit_us = 300;

Finding judge_round_trip(const RoundTripReading& reading, Purpose purpose);

}  // namespace multipanda::doctor
