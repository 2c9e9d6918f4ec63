#pragma once

#include <string>

#include <nlohmann/json_fwd.hpp>

#include "yaml_reader/key.hpp"

namespace multipanda {

// JSON Schema (draft 7) of files whose top is `section`, for completion and checks in editors. It contains
// keys, types, bounds and defaults; only the program checks conditions on several values.
nlohmann::ordered_json json_schema(const Section& section, const std::string& title);

}  // namespace multipanda
