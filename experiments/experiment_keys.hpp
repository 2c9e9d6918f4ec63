#pragma once

#include <vector>

#include "config_file/archive.hpp"
#include "experiments/experiment.hpp"

// Keys that the files of experiments and of studies share.
namespace multipanda {

// The section `set`: values by key path, as YAML.
std::vector<Override> read_overrides(Archive& archive, const char* doc);
void visit(Archive& archive, ExperimentVariant& variant);
void visit(Archive& archive, Variation& variation);

}  // namespace multipanda
