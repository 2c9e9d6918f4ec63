#pragma once

#include "ros/adapter/adapter_part.hpp"

namespace multipanda::ros {

// Makes the parts that publish arms and world: joint states, states, models, wrenches, tf, robot_description,
// /clock, statistics, events and diagnostics; and the services of a simulated run.
AdapterParts make_state(const AdapterContext& run);

}  // namespace multipanda::ros
