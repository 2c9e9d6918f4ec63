#pragma once

#include "tests/teleoperation/trial.hpp"

// Figures of teleoperation: errors of position and force, bandwidth, energy.
namespace multipanda::teleoperation {

struct FreeMotion {
  double largest_error = 0;  // between both hands [m]
  double largest_felt = 0;   // force on the leader [N]
  std::string fault;         // of the run; empty: none
};
FreeMotion free_motion(Trial trial);  // up to 0.2 m/s and 0.4 m/s^2, along all axes

struct Contact {
  double pressed = 0;  // true force at rest [N]
  double error = 0;    // largest difference to the force felt, as share of the true one, above 5 N
  double peak = 0;     // [N]
  std::string fault;
};
Contact contact(Trial trial);  // pressed within 1 s, kept, and pressed harder

struct Response {
  double gain = 0, phase = 0;  // follower's hand to leader's, free motion; [rad]
};
Response response(double frequency_hz);

// An operator who leads to and fro on the table, off it, jumps, and lets go at times.
Trial disturbed(Trial trial, std::uint32_t seed);

}  // namespace multipanda::teleoperation
