#pragma once

#include "ros/adapter/adapter_part.hpp"

namespace multipanda::ros {

// Makes the parts that follow from controllet descriptors: inputs, references, outputs, parameters, and the
// services to list and switch controllets.
AdapterParts make_controllets(const AdapterContext& run);

}  // namespace multipanda::ros
