#pragma once

#include <cstdint>
#include <string>

namespace multipanda::fci {

// How the packets of one connection fared.
struct ArmStatistics {
  std::uint64_t received = 0;       // states taken: newer than the one before
  std::uint64_t lost = 0;           // numbers that never came, while connected
  std::uint64_t lost_in_a_row = 0;  // at present
  std::uint64_t lost_in_a_row_max = 0;
  std::uint64_t superseded = 0;          // came, but a newer one was there already: this computer was late
  std::uint64_t foreign = 0;             // datagrams that are no state of this arm
  std::uint64_t sent = 0, not_sent = 0;  // commands; not_sent: the system did not take the datagram
  // From the moment a state was taken to the moment its answer left [s]: the loop's computing time.
  double answer_delay_mean_s = 0, answer_delay_max_s = 0;
  double command_success_rate = 0;  // what the arm says of the last 100 periods
};

// Who answered.
struct ArmIdentity {
  int version = 0;         // of the protocol
  std::string generation;  // "FR3", "Panda"
  bool model_checked = false;
  std::string model_report;  // what the comparison of the models found, or why there was none
};

}  // namespace multipanda::fci
