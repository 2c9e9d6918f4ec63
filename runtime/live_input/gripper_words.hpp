#pragma once

#include <string>
#include <vector>

#include "core/cycle/backend.hpp"
#include "core/record/cycle_record.hpp"
#include "runtime/live_input/json_fields.hpp"

namespace multipanda {

// Requests to grippers, by JSON: `action` and its figures. Keys beside "arm" that belong to the action are
// allowed, others refused (RequestRefused).
ArmRequest read_gripper_request(const JsonFields& fields, std::vector<std::string> common_keys);
ArmRequest read_vacuum_request(const JsonFields& fields, std::vector<std::string> common_keys);

// {"present": true, "width_m": ...}; of a gripper that is there.
nlohmann::json gripper_words(const ArmSample& sample);

}  // namespace multipanda
