#pragma once

#include <optional>
#include <vector>

#include "core/reference/reference.hpp"
#include "runtime/live_input/json_fields.hpp"

// Set-points in JSON: keys name units, frames have names.
namespace multipanda {

// The keys of all quantities, and "values": the numbers in the order of Target.
std::vector<std::string> reference_keys();

// A pose from position_m with rpy_rad or quaternion_wxyz. `rotation` is the default orientation; without it
// an orientation is required.
Pose read_pose(const JsonFields& fields, const std::optional<Matrix3>& rotation = {});

// The values of a Target in the frame of the request, as given: the loop's side checks them.
std::vector<double> read_reference(const JsonFields& fields, const InputSpec& input);

}  // namespace multipanda
