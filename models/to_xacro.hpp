#pragma once

#include <map>
#include <string>

#include "models/robot_description.hpp"

namespace multipanda {

// A robot as macros for ROS 2 descriptions, generated from the same model file: `<name>_links` (links
// and joints of the arm up to link<N+1>, which is the flange), `<name>_hand` if it has one (palm and
// sliding fingers), both with the parameter `prefix`; the properties `<name>_home` [rad] and
// `<name>_has_hand`. Shapes are primitives.
std::string to_xacro(const RobotDescription& robot);

// File name -> content of everything in ros/multipanda_description/urdf/generated: each shipped robot, and
// the colors.
std::map<std::string, std::string> exported_descriptions();

}  // namespace multipanda
