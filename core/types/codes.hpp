#pragma once

#include <cstdint>
#include <string_view>

// Result codes: what the loop says in place of exceptions and strings. Each has its text, used off the loop.
namespace multipanda {

// Why an arm or a controllet instance was interfered with; counted, shown and logged.
enum class Intervention : std::uint8_t {
  none,
  torque_not_finite,     // a controllet or feature returned NaN or infinity: taken out
  torque_implausible,    // finite, but beyond any sense: taken out
  controllet_threw,      // an exception left update(): taken out
  controllet_fault,      // update() returned LawResult::fault: taken out
  reference_stale,       // a streaming publisher fell silent: arms to hold
  state_not_finite,      // the backend delivered NaN or infinity: arm to hold
  state_old,             // no packet of an arm of the group in time: group to hold
  joint_position_limit,  // beyond a joint limit and moving outwards: to hold
  joint_velocity_limit,  // too fast: to hold
  workspace_limit,       // the end effector left its box outwards: to hold
  arm_not_ready,         // the arm left its control mode (reflex, user stop, ...): to hold
  torque_clamped,        // the torque limit cut the command
  torque_rate_clamped,   // the torque-rate limit cut the command
  stop_requested,        // someone asked for a stop: to hold until resumed
  count_                 // number of codes
};

// What became of a request.
enum class Verdict : std::uint8_t {
  pending,
  accepted,
  unknown_instance,
  unknown_arm,
  unknown_feature,
  unknown_parameter,
  unknown_input,
  wrong_size,
  not_finite,
  out_of_bounds,
  two_owners,     // two of the requested controllets own the same arm
  arm_stopped,    // an arm is stopped and must be resumed first
  arm_not_ready,  // the arm is not in its control mode
  not_active,     // the request needs a running controllet
  start_refused,  // the controllet's start() refused the measured state
  superseded,     // the set of active controllets changed in between; ask again
  queue_full,     // more requests than the loop takes in a cycle; ask again
  loop_not_running,
  timeout,
  count_
};

std::string_view to_string(Intervention code);
std::string_view to_string(Verdict code);

}  // namespace multipanda
