#pragma once

#include <cstdint>
#include <string_view>

namespace multipanda {

// What the loop side of a simulated backend says to a request; the text is made off the loop.
enum class ArmReply : std::uint8_t {
  done,
  nothing_to_recover,    // RecoverFromError without an error or stop
  user_stop_pressed,     // RecoverFromError while the user stop is pressed
  not_supported,         // this backend does not know the request
  would_penetrate,       // PlaceObject into something
  not_paused,            // StepSimulation of a world that runs
  still_stepping,        // StepSimulation while an earlier one is carried out
  no_gripper,            // a request to a gripper that the arm does not have
  gripper_unsuccessful,  // the motion is over, but not as asked
  gripper_aborted,       // by a stop or another motion
  loop_ended,            // the loop ended before it took the request
  count_
};

std::string_view to_string(ArmReply reply);

}  // namespace multipanda
