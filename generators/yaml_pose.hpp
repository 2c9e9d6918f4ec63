#pragma once

#include "core/types/spatial.hpp"
#include "models/checked_yaml.hpp"

// What files of generators have in common.
namespace multipanda {

// An angle as scene files have it: a number, or a multiple of pi as "pi", "-pi/2", "3*pi/4". [rad]
double read_angle(const CheckedYaml& entry);
// {position_m, rpy_rad}
Pose read_pose(const CheckedYaml& map);

}  // namespace multipanda
