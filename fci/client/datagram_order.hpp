#pragma once

#include <cstdint>

namespace multipanda::fci {

// Which numbered datagrams of one sender count, and which of them is the newest. The sender's port and number
// are taken from the first one; a number that jumps needs a second one that confirms it. Knows no socket and
// no clock. No allocation, no exception.
class DatagramOrder {
 public:
  enum class Taken : std::uint8_t {
    refused,    // not of this sender, or not plausible
    duplicate,  // of the newest
    late,       // older than the newest
    newest
  };

  // The next datagram is the first of another connection.
  void reset() noexcept { *this = {}; }
  // Whether it may be the sender. `port`: any number that names it.
  bool is_from(std::uint16_t port) const noexcept { return port_ == 0 || port == port_; }
  Taken take(std::uint64_t number, std::uint16_t port) noexcept;

  std::uint64_t last() const noexcept { return last_; }  // number of the newest; 0: none came yet
  // Datagrams in a row that never came before the newest.
  std::uint64_t gap() const noexcept { return gap_; }

 private:
  // A number further away than this is accepted only if the next datagram confirms it: a single wrong one
  // would make all that follow look old.
  static constexpr std::uint64_t kMostJump = 1000;
  bool is_plausible(std::uint64_t number) noexcept;

  std::uint64_t last_ = 0;
  std::uint16_t port_ = 0;        // of the first datagram; 0: none came yet
  bool confirmed_ = false;        // two numbers followed each other
  std::uint64_t far_number_ = 0;  // of the last datagram, if it was too far away to be accepted; otherwise 0
  std::uint64_t gap_ = 0;
};

}  // namespace multipanda::fci
