#pragma once

#include <string>
#include <vector>

#include "models/robot_description.hpp"

namespace multipanda {

struct UrdfOptions {
  bool hand = false;     // the hand as one rigid link `hand`, fingers closed, and the frame `hand_tcp`
  bool geometry = true;  // shapes for pictures and collision capsules (each a cylinder and two spheres)
  // The hand's fingers slide: links `leftfinger`, `rightfinger`, joints `finger_joint1`, `finger_joint2`
  // (which mimics the first).
  bool fingers = false;
  std::string prefix = "";        // of every link and joint: "left_"
  std::string flange = "flange";  // the flange's link; its joint is `<flange>_joint`
};

// One of several arms.
struct PlacedRobot {
  RobotDescription robot;
  UrdfOptions options;  // each arm needs its own prefix
  Pose X_WB;            // its base in the world
};

// URDF of one arm: links link0..linkN, joints joint1..jointN (revolute or prismatic), then the fixed frame
// `flange`.
// No joint friction or damping: controllers see the rigid body only. Numbers are exact.
// Throws std::invalid_argument if a hand is requested and the robot has none.
std::string to_urdf(const RobotDescription& robot, const UrdfOptions& options = {});
// URDF of several arms on the link `world`, each by a fixed joint `<prefix>base_joint` to its link0.
std::string to_urdf(const std::string& name, const std::vector<PlacedRobot>& arms);

}  // namespace multipanda
