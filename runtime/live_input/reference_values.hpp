#pragma once

#include <vector>

#include "core/reference/reference.hpp"
#include "runtime/live_input/json_fields.hpp"
#include "runtime/target_values.hpp"

// Set-points as the outside says them: units in the keys, a frame by name.
namespace multipanda {

// Keys that carry a quantity: {"position_m", "rpy_rad", "quaternion_wxyz"}.
std::vector<std::string> keys_of(Quantity quantity);
// All of them, of every quantity.
std::vector<std::string> reference_keys();

// A pose from position_m with rpy_rad or quaternion_wxyz.
Pose read_pose(const JsonFields& fields);

// The values of a Target, in the frame in which they were given. `size`: of the input (Reference::size).
std::vector<double> read_reference(const JsonFields& fields, const InputSpec& input, std::size_t size);

}  // namespace multipanda
