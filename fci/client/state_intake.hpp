#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "fci/wire/state_layout.hpp"

namespace multipanda::fci {

// Which datagrams of an arm are states, and which of these is the newest. Knows no socket and no clock. The
// arm's port and number are taken from the first state; a number that jumps needs a second one that confirms
// it. No allocation, no exception.
class StateIntake {
 public:
  // From now on states in this dialect, whatever their number; nullptr: none.
  void expect(const Dialect* dialect) noexcept;
  const Dialect* dialect() const noexcept { return dialect_; }

  enum class Taken : std::uint8_t {
    refused,    // no state of this arm, or not plausible
    duplicate,  // of the newest
    late,       // older than the newest
    newest
  };
  // `port`: the sender's, any number that names it.
  Taken take(std::span<const std::byte> datagram, std::uint16_t port) noexcept;

  // The newest state; its message_id is 0 before the first one.
  const RobotState& state() const noexcept { return states_[newest_]; }
  // States in a row that never came before state().
  std::uint64_t gap() const noexcept { return gap_; }

 private:
  // A number further away than this is accepted only if the next datagram confirms it: a single wrong one
  // would make all that follow look old.
  static constexpr std::uint64_t kMostJump = 1000;
  bool is_plausible(std::uint64_t number, std::uint64_t last) noexcept;

  const Dialect* dialect_ = nullptr;
  std::array<RobotState, 2> states_;
  std::size_t newest_ = 0;
  std::uint16_t port_ = 0;        // of the arm's states in this connection; 0: none came yet
  bool confirmed_ = false;        // two states of this connection had numbers that follow each other
  std::uint64_t far_number_ = 0;  // of the last datagram, if it was too far away to be accepted; otherwise 0
  std::uint64_t gap_ = 0;
};

}  // namespace multipanda::fci
