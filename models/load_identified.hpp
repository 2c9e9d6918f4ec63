#pragma once

#include "models/checked_yaml.hpp"
#include "models/robot_description.hpp"

// The sections of a model file that say what one arm is and does beyond its make, as identification finds it
// (docs/models.md). `n`: number of joints. All throw std::invalid_argument with file and line.
namespace multipanda {

// Whether a section that may be missing was taken away: the word `none` in place of its keys, so that a file
// can be without a section that its base has.
bool is_taken_away(const CheckedYaml& section);

// Keys p1_nm, p2_s_per_rad, p3_rad_per_s; p1 and p2 not below 0.
JointFriction read_sigmoid(const CheckedYaml& section, std::size_t n);
FrictionLaw read_link_friction(const CheckedYaml& section, std::size_t n);
TorqueSensor read_torque_sensor(const CheckedYaml& section, std::size_t n);
Actuation read_actuation(const CheckedYaml& section);
JointVector read_motor_inertia(const CheckedYaml& section, std::size_t n);
Eigen::Vector2d read_base_tilt(const CheckedYaml& section);

}  // namespace multipanda
