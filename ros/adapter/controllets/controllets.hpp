#pragma once

#include "ros/adapter/adapter_part.hpp"

namespace multipanda::ros {

class Inputs;

// Makes the parts that follow from controllet descriptors: inputs, references, outputs, parameters, and the
// services to list and switch controllets. `inputs`: the part that has the ports of all inputs.
AdapterParts make_controllets(const AdapterContext& run, const Inputs*& inputs);

}  // namespace multipanda::ros
