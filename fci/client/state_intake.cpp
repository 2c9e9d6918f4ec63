#include "fci/client/state_intake.hpp"

namespace multipanda::fci {

void StateIntake::expect(const Dialect* dialect) noexcept {
  dialect_ = dialect;
  states_[newest_].message_id = 0;
  order_.reset();
}

StateIntake::Taken StateIntake::take(std::span<const std::byte> datagram, std::uint16_t port) noexcept {
  RobotState& next = states_[1 - newest_];
  if (dialect_ == nullptr || !order_.is_from(port) || decode(*dialect_, datagram, next) != WireResult::ok) {
    return Taken::refused;
  }
  const Taken taken = order_.take(next.message_id, port);
  if (taken == Taken::newest) newest_ = 1 - newest_;
  return taken;
}

}  // namespace multipanda::fci
