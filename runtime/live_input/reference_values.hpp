#pragma once

#include <optional>
#include <vector>

#include "core/reference/reference.hpp"
#include "runtime/live_input/json_fields.hpp"
#include "runtime/target_values.hpp"

// Set-points in JSON: keys name units, frames have names.
namespace multipanda {

// Keys that carry a quantity: {"position_m", "rpy_rad", "quaternion_wxyz"}.
std::vector<std::string> keys_of(Quantity quantity);
// The keys of all quantities.
std::vector<std::string> reference_keys();

// A pose from position_m with rpy_rad or quaternion_wxyz. `rotation` is the default orientation; without it
// an orientation is required.
Pose read_pose(const JsonFields& fields, const std::optional<Matrix3>& rotation = {});

// The values of a Target in the frame of the request. `size`: number of values of the input
// (Reference::size).
std::vector<double> read_reference(const JsonFields& fields, const InputSpec& input, std::size_t size);

}  // namespace multipanda
