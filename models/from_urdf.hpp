#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>

#include "models/robot_description.hpp"

namespace multipanda {

// Replace what the URDF says, or stand in for what it does not say.
struct UrdfLimits {
  std::optional<double> lower, upper;  // [rad]
  std::optional<double> velocity;      // [rad/s]
  std::optional<double> effort;        // [N m]
};

// Which part of a robot is the arm. From base_link to tip_link, every revolute or continuous joint that is
// not held is a joint of the arm, in this order; all others stand still.
struct UrdfChain {
  std::string base_link;                      // becomes link0: a scene places it in the world
  std::string tip_link;                       // becomes the flange
  std::map<std::string, double> held_joints;  // where they stand [rad] or [m]. Others that are no joint of
                                              // the arm: at 0, or the nearest that their limits allow
  std::map<std::string, UrdfLimits> limits;   // by the URDF's name of the joint
};

// The arm inside a robot. Links that move together become one, with the exact mass properties of all of them:
// grippers, covers and whatever else an arm's link carries. Of what the base carries, only the part fixed to
// it counts (it does not move). Axes other than z are turned to z, so frames of links are not the URDF's; the
// joints' zero positions and directions are. Interface limits are kUrdf..., the home configuration is zero
// where the limits allow it; shapes are sticks from joint to joint, for pictures only. Throws
// std::invalid_argument: what is wrong and the cure.
RobotDescription robot_from_urdf(const std::string& urdf_text, const UrdfChain& chain);

// Of every joint of an imported arm, unless its model file says otherwise: a URDF knows no such limits.
inline constexpr double kUrdfAcceleration = 10;  // [rad/s^2]
inline constexpr double kUrdfJerk = 5000;        // [rad/s^3]
inline constexpr double kUrdfTorqueRate = 1000;  // [N m/s]

// The file behind "package://NAME/REST" (REST below the folder of that name in the share folders of
// AMENT_PREFIX_PATH, or in the Python environment's example-robot-data), or behind a path, which stands
// beside `folder` if it is relative. Throws std::invalid_argument where it looked.
std::filesystem::path urdf_file(const std::string& name, const std::filesystem::path& folder);

}  // namespace multipanda
