#pragma once

#include <string>

#include "models/robot_description.hpp"

namespace multipanda {

struct UrdfOptions {
  bool hand = false;     // the hand as one rigid link `hand`, fingers closed, and the frame `hand_tcp`
  bool geometry = true;  // shapes for pictures and collision capsules (each a cylinder and two spheres)
};

// URDF of one arm: links link0..linkN, revolute joints joint1..jointN, then the fixed frame `flange`.
// No joint friction or damping: controllers see the rigid body only. Numbers are exact.
// Throws std::invalid_argument if a hand is asked for and the robot has none.
std::string to_urdf(const RobotDescription& robot, const UrdfOptions& options = {});

}  // namespace multipanda
