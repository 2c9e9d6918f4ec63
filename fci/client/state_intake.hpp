#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "core/types/arm_set.hpp"
#include "fci/wire/state_layout.hpp"

namespace multipanda::fci {

// Decides which numbered datagrams of one sender are valid and which is the newest. The sender's port and
// number come from the first one; a jump must be confirmed by a second datagram. Independent of sockets and
// clocks. No allocation, no exception.
class DatagramOrder {
 public:
  enum class Taken : std::uint8_t {
    refused,    // not of this sender, or not plausible
    duplicate,  // of the newest
    late,       // older than the newest
    newest
  };

  // The next datagram starts another connection.
  void reset() noexcept { *this = {}; }
  // Whether it may be the sender. `port`: any number that identifies it.
  bool is_from(std::uint16_t port) const noexcept { return port_ == 0 || port == port_; }
  Taken take(std::uint64_t number, std::uint16_t port) noexcept;

  std::uint64_t last() const noexcept { return last_; }  // number of the newest; 0: none yet
  // Consecutive datagrams missing before the newest.
  std::uint64_t gap() const noexcept { return gap_; }

 private:
  // A number farther away than this is accepted only if the next datagram confirms it: a single wrong one
  // would make all later ones look old.
  static constexpr std::uint64_t kMostJump = 1000;
  bool is_plausible(std::uint64_t number) noexcept;

  std::uint64_t last_ = 0;
  std::uint16_t port_ = 0;        // of the first datagram; 0: none yet
  bool confirmed_ = false;        // two numbers followed each other
  std::uint64_t far_number_ = 0;  // of the last datagram, if it was too far away to be accepted; otherwise 0
  std::uint64_t gap_ = 0;
};

// Filters an arm's datagrams for states, and keeps the newest (DatagramOrder). No allocation, no exception.
class StateIntake {
 public:
  using Taken = DatagramOrder::Taken;

  // Accepts states in this dialect from now on, with any number; nullptr: none.
  void expect(const Dialect* dialect) noexcept;
  const Dialect* dialect() const noexcept { return dialect_; }

  // `port`: the sender's. A datagram that is not a state is refused.
  Taken take(std::span<const std::byte> datagram, std::uint16_t port) noexcept;

  // The newest state; its message_id is 0 before the first one.
  const RobotState& state() const noexcept { return states_[newest_]; }
  // Consecutive states missing before state().
  std::uint64_t gap() const noexcept { return order_.gap(); }

 private:
  const Dialect* dialect_ = nullptr;
  DatagramOrder order_;
  std::array<RobotState, 2> states_;
  std::size_t newest_ = 0;
};

// The first cycle waits for a state of every arm. A started arm must be answered meanwhile: it would stop
// after 20 missing answers.
class FirstStates {
 public:
  // The arm's newest state is unanswered, and states of other arms are missing. True: it is not the arm's
  // first one in this wait, and not held yet.
  bool is_to_be_held(ArmIndex arm, std::uint64_t number) {
    std::uint64_t& last = last_[arm];
    const bool further = last != 0 && number != last;
    last = number;
    return further;
  }

 private:
  std::array<std::uint64_t, kMaxArms> last_{};  // number of the newest state; 0: none yet
};

}  // namespace multipanda::fci
