#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "fci/client/datagram_order.hpp"
#include "fci/wire/state_layout.hpp"

namespace multipanda::fci {

// Which datagrams of an arm are states, and the newest of them (DatagramOrder). No allocation, no exception.
class StateIntake {
 public:
  using Taken = DatagramOrder::Taken;

  // From now on states in this dialect, whatever their number; nullptr: none.
  void expect(const Dialect* dialect) noexcept;
  const Dialect* dialect() const noexcept { return dialect_; }

  // `port`: the sender's. A datagram that is no state is refused.
  Taken take(std::span<const std::byte> datagram, std::uint16_t port) noexcept;

  // The newest state; its message_id is 0 before the first one.
  const RobotState& state() const noexcept { return states_[newest_]; }
  // States in a row that never came before state().
  std::uint64_t gap() const noexcept { return order_.gap(); }

 private:
  const Dialect* dialect_ = nullptr;
  DatagramOrder order_;
  std::array<RobotState, 2> states_;
  std::size_t newest_ = 0;
};

}  // namespace multipanda::fci
