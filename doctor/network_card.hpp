#pragma once

#include <optional>

#include "doctor/finding.hpp"
#include "doctor/system_files.hpp"

namespace multipanda::doctor {

// The network card on the route to an arm, and its counters of dropped and damaged packets.
struct NetworkCardReading {
  std::string address;    // of the arm
  std::string interface;  // "eth0"; empty: no route
  std::string reason;     // why there is no route
  bool loopback = false, wireless = false, usb = false, virtual_card = false;
  std::string gateway;          // of the route; empty: the arm is on the same wire
  std::optional<double> mtu;    // [bytes]
  std::optional<double> speed;  // [Mbit/s]
  bool full_duplex = true;
  std::optional<double> coalesce_us;  // delay of the card's notification of a packet
  double damaged = 0, dropped = 0;    // packets since the card was started
};
NetworkCardReading read_network_card(const std::string& address, const SystemFiles& files);

Finding judge_network_card(const NetworkCardReading& reading, Purpose purpose);

}  // namespace multipanda::doctor
