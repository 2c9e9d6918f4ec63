#include "fci/client/state_intake.hpp"

#include <utility>

namespace multipanda::fci {

void StateIntake::expect(const Dialect* dialect) noexcept {
  dialect_ = dialect;
  states_[newest_].message_id = 0;
  port_ = 0;
  confirmed_ = false;
  far_number_ = 0;
}

StateIntake::Taken StateIntake::take(std::span<const std::byte> datagram, std::uint16_t port) noexcept {
  RobotState& next = states_[1 - newest_];
  const std::uint64_t last = state().message_id;
  if (dialect_ == nullptr || (port_ != 0 && port != port_) ||
      decode(*dialect_, datagram, next) != WireResult::ok || next.message_id == 0 ||
      !is_plausible(next.message_id, last)) {
    return Taken::refused;
  }
  // Late or a duplicate; except that the first state of a connection may itself have been the wrong one.
  if (next.message_id <= last && (confirmed_ || last - next.message_id <= kMostJump)) {
    return next.message_id < last ? Taken::late : Taken::duplicate;
  }
  gap_ = last == 0 || next.message_id <= last ? 0 : next.message_id - last - 1;
  confirmed_ = confirmed_ || last != 0;
  newest_ = 1 - newest_;
  port_ = port;
  return Taken::newest;
}

bool StateIntake::is_plausible(std::uint64_t number, std::uint64_t last) noexcept {
  const std::uint64_t far = std::exchange(far_number_, 0);
  if (last == 0 || (number <= last && confirmed_)) return true;
  if ((number > last ? number - last : last - number) <= kMostJump) return true;
  if (far != 0 && number > far && number - far <= kMostJump) return true;
  far_number_ = number;
  return false;
}

}  // namespace multipanda::fci
