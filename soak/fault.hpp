#pragma once

#include <cstdint>
#include <string_view>

#include "core/types/arm_set.hpp"

namespace multipanda {

// What an endurance run does to its arms, its program and its disk.
enum class Fault : std::uint8_t {
  reflex,        // the arm finds an error
  cable,         // nothing passes between the arm and the program
  user_stop,     // the button is pressed and released
  push,          // a force of up to 30 N on the flange
  lost_answers,  // 1 to 19 in a row
  late_answers,  // 1 to 19 in a row
  lost_states,   // 1 to 19 in a row
  client_stall,  // the program stands still for 1 to 50 ms
  client_lost,   // the program disappears, and another one connects
  switches,      // a storm of requests for other owners
  parameters,    // a storm of new values
  goals,         // a storm of goals
  full_disk,     // the log cannot grow
  slow_disk,     // nobody takes the log's records
  count_
};

std::string_view name_of(Fault fault);

// One of them, as it happened.
struct InjectedFault {
  double at_s = 0;
  Fault fault = Fault::reflex;
  ArmSet arms;  // that it may stop or disturb; none: it may disturb nobody
};

}  // namespace multipanda
