#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/cycle/requests.hpp"
#include "core/record/cycle_record.hpp"
#include "core/reference/reference.hpp"
#include "runtime/live_input/json_fields.hpp"

namespace multipanda {

// Every name of core/cycle/requests.hpp, each once: "set_load", "gripper", "pause", ...
std::vector<std::string> backend_request_names();

// The request `name` from its JSON fields. Allowed are the request's own keys, `common_keys`, and "arm"
// unless the request is for the world. Throws RequestRefused.
BackendRequest read_backend_request(const std::string& name, const JsonFields& fields,
                                    std::vector<std::string> common_keys);

// Whether it moves a real arm or the fingers of its gripper.
bool moves(const BackendRequest& request);

// The quantities that an arm of `joints` joints reports, by name, without unknown ones; those of the gripper
// in "gripper": {"width_m": ...}. "mode" and "error_names" are strings.
nlohmann::json state_of(const ArmSample& sample, std::size_t joints);

// Set-points in JSON: keys name units, frames have names.

// The keys of all quantities, and "values": the numbers in the order of Target.
std::vector<std::string> reference_keys();

// A pose from position_m with rpy_rad or quaternion_wxyz. `rotation` is the default orientation; without it
// an orientation is required.
Pose read_pose(const JsonFields& fields, const std::optional<Matrix3>& rotation = {});

// The values of a Target in the frame of the request, as given: the loop's side checks them.
std::vector<double> read_reference(const JsonFields& fields, const InputSpec& input);

}  // namespace multipanda
