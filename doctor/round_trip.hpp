#pragma once

#include "doctor/distribution.hpp"
#include "doctor/finding.hpp"

namespace multipanda::doctor {

// Round-trip time of a packet to the arm's control unit, without a request to the arm.
struct RoundTripReading {
  std::string address;
  std::string method;  // "ICMP echo of 1200 bytes"; empty: none was possible
  std::string reason;  // why not
  std::vector<double> us;
  std::size_t sent = 0;
};
// Sends echo requests of the size of the arm's packets at 1 kHz for `seconds`. If this user may not send
// them, it measures the time to open a connection to the control port ten times.
RoundTripReading read_round_trip(const std::string& address, double seconds);

// Franka's limit of the round trip.
inline constexpr double kRoundTripLimit_us = 300;

Finding judge_round_trip(const RoundTripReading& reading, Purpose purpose);

}  // namespace multipanda::doctor
