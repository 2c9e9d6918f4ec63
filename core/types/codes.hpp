#pragma once

#include <cstdint>
#include <string_view>

// Result codes, which the loop reports in place of exceptions and strings. Their texts are for use
// off the loop.
namespace multipanda {

// A rule by which the safety stage intervenes on an arm or a controllet instance; counted, shown and logged.
// "Removed": the controllet is deactivated and its arms are held.
enum class Intervention : std::uint8_t {
  none,
  torque_not_finite,     // a controllet or feature returned NaN or infinity: removed
  torque_implausible,    // finite, but far beyond any torque limit: removed
  controllet_threw,      // an exception left update(): removed
  controllet_fault,      // update() returned LawResult::fault: removed
  reference_stale,       // a stream of set-points stopped: arms are held
  state_not_finite,      // the backend delivered NaN or infinity: arm is held
  state_old,             // no recent packet of an arm of the group: group is held
  joint_position_limit,  // beyond a joint limit and moving outwards: arm is held
  joint_velocity_limit,  // a joint exceeded its velocity limit: arm is held
  workspace_limit,       // hand, flange or tool left the box, moving outwards: arm is held
  arm_not_ready,         // the arm left its control mode (reflex, user stop, ...): arm is held
  torque_clamped,        // the torque limit clamped the command
  torque_rate_clamped,   // the torque-rate limit clamped the command
  stop_requested,        // a stop was requested: arm is held until resumed
  observed_arm_lost,     // an arm that the controllet observes is silent or in error: its arms are held
  // The controllet needs the force sensor of one of its arms: removed.
  force_sensor_silent,        // no recent record of it
  force_sensor_saturated,     // beyond its range
  force_sensor_fault,         // it reports an error, was restarted, or sends what is not a number
  force_sensor_not_tared,     // the arm has not been at rest, or bears more than a bias
  force_sensor_contradicted,  // the arm's own estimate is another
  count_                      // number of codes
};

// Result of a request.
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
  superseded,     // the set of active controllets changed in the meantime; try again
  queue_full,     // more requests than the loop takes in a cycle; try again
  loop_not_running,
  timeout,
  observes_itself,  // a controllet would observe its own arm through others
  count_
};

std::string_view to_string(Intervention code);
std::string_view unit_of(Intervention code);  // of its value and limit: "N m/s"; empty: it has none
std::string_view to_string(Verdict code);
std::string_view name_of(Verdict code);  // for programs: "two_owners"

}  // namespace multipanda
