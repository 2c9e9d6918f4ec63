#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "models/robot_description.hpp"

namespace multipanda {

// Writes `robot` as a model file based on `base` (which must come from a file): name, title, notes of
// origin, and only the sections in which the two differ. Numbers have 17 digits, so that load_robot gives
// back equal ones. Sections that may differ: joints, flange, inertials, both frictions, torque sensor,
// actuation, motor inertia, tilt, home. The file is written atomically. Throws std::invalid_argument
// if something else differs or the numbers would be refused when read, std::runtime_error if the file cannot
// be written.
void write_robot(const RobotDescription& robot, const RobotDescription& base,
                 const std::filesystem::path& file);

struct UrdfOptions {
  bool hand = false;  // with the hand as one rigid link `hand`, fingers closed, and the frame `hand_tcp`
  bool geometry =
      true;  // shapes for pictures and collision capsules (each a cylinder and two spheres; link1's is cut)
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
  // Fraction of the rotors' inertia that the arm's torque loop compensates, 0 to 1; the rest is armature.
  // Other programs have no such loop.
  double rotor_hidden = 1;
  bool actuators = true;         // false: none, for forces that are applied to the joints
  std::string prefix;            // put before every name
  bool visuals = true;           // false: no visible geoms
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

// A robot as macros for ROS 2 descriptions, generated from the same model file: `<name>_links` (links
// and joints of the arm up to link<N+1>, which is the flange), `<name>_hand` if it has one (palm and
// sliding fingers), both with the parameter `prefix`; the properties `<name>_home` [rad] and
// `<name>_has_hand`. Shapes are primitives.
std::string to_xacro(const RobotDescription& robot);

// File name -> content of everything in ros/multipanda_description/urdf/generated: each shipped robot, and
// the colors.
std::map<std::string, std::string> exported_descriptions();

// File name -> content of everything in models/generated: each shipped robot as URDF and MJCF, with and
// without hand.
std::map<std::string, std::string> exported_models();

}  // namespace multipanda
