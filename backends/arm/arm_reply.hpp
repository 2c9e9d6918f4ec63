#pragma once

#include <cstdint>
#include <string_view>

namespace multipanda {

// What the loop side of a simulated backend says to a request; the text is made off the loop.
enum class ArmReply : std::uint8_t {
  done,
  nothing_to_recover,  // RecoverFromError without an error or stop
  user_stop_pressed,   // RecoverFromError while the user stop is pressed
  not_supported,       // this backend does not know the request
  would_penetrate,     // PlaceObject into something
  loop_ended,          // the loop ended before it took the request
  count_
};

std::string_view to_string(ArmReply reply);

// Error flags of the control interface that the simulated arm raises: bit i of ArmState::errors.
enum class ArmError : std::uint8_t {
  communication_constraints_violation = 25,  // too many commands missing in a row
  controller_torque_discontinuity = 32,      // a command that is no torque: NaN, infinity, wrong size
};

constexpr std::uint64_t error_bit(ArmError error) {
  return std::uint64_t{1} << static_cast<std::uint8_t>(error);
}

}  // namespace multipanda
