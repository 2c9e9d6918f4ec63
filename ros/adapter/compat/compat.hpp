#pragma once

#include "ros/adapter/adapter_part.hpp"

namespace multipanda::ros {

class Inputs;

// Makes the parts that have names and types of another system (`ros: {compat: ...}`), none without that key.
// `inputs`: the part with the ports of all inputs; nullptr: the run has no controllets here. Throws
// std::invalid_argument if the messages are missing or do not match.
AdapterParts make_compat(const AdapterContext& run, const Inputs* inputs);

}  // namespace multipanda::ros
