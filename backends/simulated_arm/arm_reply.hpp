#pragma once

#include <cstdint>
#include <string_view>

namespace multipanda {

// Reply of a simulated backend's loop to a request; the text is composed off the loop.
enum class ArmReply : std::uint8_t {
  done,
  nothing_to_recover,    // RecoverFromError without an error or stop
  user_stop_pressed,     // RecoverFromError while the user stop is pressed
  not_supported,         // this backend does not support the request
  would_penetrate,       // PlaceObject into another object
  not_paused,            // StepSimulation of a running world
  still_stepping,        // StepSimulation while an earlier one is carried out
  no_gripper,            // the arm has no such gripper
  gripper_unsuccessful,  // the gripper motion did not succeed
  vacuum_unsuccessful,   // no vacuum in time
  gripper_aborted,       // by a stop or another motion
  loop_ended,            // the loop ended before it took the request
  too_late,              // its asker may have given up by then
  count_
};

std::string_view to_string(ArmReply reply);

}  // namespace multipanda
