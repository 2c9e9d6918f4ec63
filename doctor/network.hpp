#pragma once

#include <optional>

#include "doctor/finding.hpp"

namespace multipanda::doctor {

// The network card on the route to an arm, and its counters of dropped and damaged packets.
struct NetworkCardReading {
  std::string address;    // of the arm
  std::string interface;  // "eth0"; empty: no route
  std::string reason;     // why there is no route
  bool loopback = false, wireless = false, usb = false, virtual_card = false;
  std::string gateway;          // of the route; empty: the arm is on the same network
  std::optional<double> mtu;    // [bytes]
  std::optional<double> speed;  // [Mbit/s]
  bool full_duplex = true;
  std::optional<double> coalesce_us;  // delay of the card's notification of a packet
  double damaged = 0, dropped = 0;    // packets since the card was started
};
NetworkCardReading read_network_card(const std::string& address, const SystemFiles& files);

Finding judge_network_card(const NetworkCardReading& reading, Purpose purpose);

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
