#pragma once

#include <cstdint>

namespace multipanda {

// Packets of one arm's connection.
struct ConnectionStatistics {
  std::uint64_t received = 0;       // states taken: newer than the one before
  std::uint64_t lost = 0;           // sequence numbers that never arrived, while connected
  std::uint64_t lost_in_a_row = 0;  // at present
  std::uint64_t lost_in_a_row_max = 0;
  std::uint64_t superseded = 0;          // states that arrived after a newer one: this computer was late
  std::uint64_t foreign = 0;             // datagrams that are not a state of this arm
  std::uint64_t sent = 0, not_sent = 0;  // commands; not_sent: the system did not accept the datagram
  // From taking a state to sending its answer: the loop's computing time [s].
  double answer_delay_mean_s = 0, answer_delay_max_s = 0;
  double command_success_rate = 0;  // as the arm reports it, of the last 100 periods
};

}  // namespace multipanda
