#pragma once

#include "fci/server/arm_port.hpp"

namespace multipanda::fci {

// The connected program.
struct ArmPort::Client {
  Client(Accepted accepted, Poll& poll, Port& port)
      : stream(std::move(accepted.socket), accepted.peer, poll, port), since(host_now()) {}

  TcpStream stream;
  HostTime since;
  const Dialect* dialect = nullptr;  // none before Connect
  Socket udp;
  bool watches_udp = false;
  bool closing = false;  // once everything is sent
};

}  // namespace multipanda::fci
