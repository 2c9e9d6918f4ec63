#include "fci/wire/state_layout.hpp"

namespace multipanda::fci {

std::size_t encode(const Dialect& d, const RobotState& state, std::span<std::byte> to) {
  Writer a(to, d.is_single_precision());
  carry_state(a, state, d);
  return a.result() == WireResult::ok ? a.size() : 0;
}

std::size_t encode(const Dialect& d, const RobotCommand& command, std::span<std::byte> to) {
  Writer a(to);
  carry_command(a, command, d);
  return a.result() == WireResult::ok ? a.size() : 0;
}

WireResult decode(const Dialect& d, std::span<const std::byte> from, RobotState& state) {
  Reader a(from, d.is_single_precision());
  carry_state(a, state, d);
  if (const WireResult result = a.result(false); result != WireResult::ok) return result;
  const bool defined = state.motion_generator_mode <= static_cast<std::uint8_t>(MotionGeneratorMode::none) &&
                       state.controller_mode <= static_cast<std::uint8_t>(ControllerMode::other) &&
                       state.robot_mode <= static_cast<std::uint8_t>(RobotMode::automatic_error_recovery);
  return defined ? WireResult::ok : WireResult::bad_value;
}

WireResult decode(const Dialect& d, std::span<const std::byte> from, RobotCommand& command) {
  Reader a(from);
  carry_command(a, command, d);
  return a.result(true);
}

}  // namespace multipanda::fci
