#include "fci/client/state_intake.hpp"

#include <utility>

namespace multipanda::fci {

DatagramOrder::Taken DatagramOrder::take(std::uint64_t number, std::uint16_t port) noexcept {
  if (!is_from(port) || number == 0 || !is_plausible(number)) return Taken::refused;
  // Late or duplicate; but the first datagram of a connection may itself have been wrong.
  if (number <= last_ && (confirmed_ || last_ - number <= kMostJump)) {
    return number < last_ ? Taken::late : Taken::duplicate;
  }
  gap_ = last_ == 0 || number <= last_ ? 0 : number - last_ - 1;
  confirmed_ = confirmed_ || last_ != 0;
  last_ = number;
  port_ = port;
  return Taken::newest;
}

bool DatagramOrder::is_plausible(std::uint64_t number) noexcept {
  const std::uint64_t far = std::exchange(far_number_, 0);
  if (last_ == 0 || (number <= last_ && confirmed_)) return true;
  if ((number > last_ ? number - last_ : last_ - number) <= kMostJump) return true;
  if (far != 0 && number > far && number - far <= kMostJump) return true;
  far_number_ = number;
  return false;
}

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
