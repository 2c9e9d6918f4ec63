#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <variant>
#include <vector>

// The same type as in scene/from_parameters.hpp, which would include headers of the core.
namespace multipanda::ros {

using ParameterValue = std::variant<bool, std::int64_t, double, std::string, std::vector<bool>,
                                    std::vector<std::int64_t>, std::vector<double>, std::vector<std::string>>;
using FlatParameters = std::vector<std::pair<std::string, ParameterValue>>;

}  // namespace multipanda::ros
