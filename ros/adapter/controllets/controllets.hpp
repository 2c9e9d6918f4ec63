#pragma once

#include "ros/adapter/part.hpp"

namespace multipanda::ros {

// Everything that is generated from what controllets state: inputs, set-points followed, outputs, parameters,
// and the services about what runs.
Parts make_controllets(const AdapterWorld& world);

}  // namespace multipanda::ros
