#pragma once

#include "ros/adapter/part.hpp"

namespace multipanda::ros {

// What a run shows of its arms and its world: joint states, states, models, wrenches, tf, robot_description,
// /clock, statistics, events, diagnostics; and the services of a simulated world.
Parts make_state(const AdapterWorld& world);

}  // namespace multipanda::ros
