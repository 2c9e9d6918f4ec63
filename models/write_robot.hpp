#pragma once

#include <filesystem>

#include "models/robot_description.hpp"

namespace multipanda {

// Writes `robot` as a model file based on `base` (which must come from a file): name, title, notes of
// origin, and only the sections in which the two differ. Numbers have 17 digits, so that load_robot gives
// back equal ones. What can differ: joints, flange, inertials, both frictions, torque sensor, actuation,
// motor inertia, tilt, home. The file appears complete or not at all. Throws std::invalid_argument if
// something else differs or the numbers would be refused when read, std::runtime_error if the file
// cannot be written.
void write_robot(const RobotDescription& robot, const RobotDescription& base,
                 const std::filesystem::path& file);

}  // namespace multipanda
