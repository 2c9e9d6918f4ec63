#pragma once

#include <filesystem>
#include <string>

#include "models/robot_description.hpp"

namespace multipanda {

// Which geoms of a scene collide: `type` is the kind of a geom, `affinity` the kinds that it touches; MuJoCo
// lets two geoms touch if either touches the other. Links touch links of any arm, objects and the floor;
// link0 and link1 do not touch the floor, because Franka's capsules reach through it, nor each other, because
// they overlap. MuJoCo's default (1, 1) counts as floor.
struct CollisionBits {
  int type = 0;
  int affinity = 0;
};
inline constexpr CollisionBits kFloorBits{1, 2 | 4};
inline constexpr CollisionBits kArmBits{2, 1 | 2 | 4 | 8};     // link2 and up, and the hand
inline constexpr CollisionBits kObjectBits{4, 1 | 2 | 4 | 8};  // everything else in a scene
inline constexpr CollisionBits kBaseBits{8, 2 | 4};            // link0 and link1

enum class Fingers { locked, movable };

struct MjcfOptions {
  bool hand = false;
  // locked: part of the rigid hand, closed, exactly as in the URDF. movable: two mirrored slide joints
  // `finger_joint1`, `finger_joint2`, coupled by the equality `fingers`, and the position actuator `fingers`,
  // control 0 (closed) to the travel [m]; collision boxes left_finger1..N, right_finger1..N.
  Fingers fingers = Fingers::locked;
  // Friction beyond the torque sensor, as far as MJCF can express it: viscous as damping, Stribeck
  // and presliding amplitudes together as frictionloss. For other programs; our own plant simulates
  // the complete law.
  bool friction = false;
  // How much of the rotors' inertia the torque loop of the arm hides, 0 to 1; the rest is armature. Other
  // programs have no such loop.
  double rotor_hidden = 1;
  bool finger_servo = true;      // false: no actuator `fingers`; the force on the finger joints is applied
  std::string prefix;            // put before every name
  std::filesystem::path meshes;  // folder of meshes to show in place of the primitives; empty: primitives
};

// MJCF of one arm: body link0 at the origin, joints (hinge or slide) and motors (gear 1, no limit of control)
// joint1..jointN, sites `flange` and `hand_tcp`. Armature is the motors' inertia that
// acts (acting_motor_inertia); damping and friction are
// zero: the plant simulates them. Visible geoms are in group 2 and touch
// nothing, collision capsules are in group 3. No <option>: the scene sets time step and integrator. Throws
// std::invalid_argument if a hand is requested and the robot has none.
std::string to_mjcf(const RobotDescription& robot, const MjcfOptions& options = {});

// Folder of the Panda's meshes of the Python package example-robot-data, if it is installed in the project's
// environment; otherwise empty.
std::filesystem::path installed_meshes();

}  // namespace multipanda
