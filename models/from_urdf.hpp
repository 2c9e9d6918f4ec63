#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "models/robot_description.hpp"
#include "models/urdf_tree.hpp"

namespace multipanda {

// Limits of a joint that replace or complete those of the URDF.
struct UrdfLimits {
  std::optional<double> lower, upper;  // [rad], of a prismatic joint [m]
  std::optional<double> velocity;      // [rad/s], [m/s]
  std::optional<double> effort;        // [N m], [N]
  std::optional<bool> prismatic = {};  // kind of joint that the units assume; none: unchecked
};

// Selects the arm within a robot. From base_link to tip_link, every revolute, continuous or
// prismatic joint that is not held is a joint of the arm, in this order; all others do not move.
struct UrdfChain {
  std::string base_link;                      // becomes link0: a scene places it in the world
  std::string tip_link;                       // becomes the flange
  std::map<std::string, double> held_joints;  // positions of held joints [rad] or [m]. Other joints outside
                                              // the arm are at 0, or the nearest value within their limits
  std::map<std::string, UrdfLimits> limits;   // by the URDF's name of the joint
};

// The arm inside a robot. Links that move together become one, with the exact mass properties of all of them:
// grippers, covers and other attachments. Only the fixed attachments of the base count (the base
// does not move). Axes other than z are turned to z, so frames of links are not the URDF's; the
// joints' zero positions and directions are. Interface limits are kUrdf..., the home configuration is zero
// where the limits allow it; shapes are thin capsules from joint to joint, for pictures only. Throws
// std::invalid_argument with the fault and the remedy.
RobotDescription robot_from_urdf(const std::string& urdf_text, const UrdfChain& chain);

// Limits of every joint of an imported arm, unless its model file has others: a URDF has no such limits.
inline constexpr double kUrdfAcceleration = 10;  // [rad/s^2]
inline constexpr double kUrdfJerk = 5000;        // [rad/s^3]
inline constexpr double kUrdfTorqueRate = 1000;  // [N m/s]
// Those of a prismatic joint. Its force may rise to its limit within 0.1 s, and by at least 1000 N/s.
inline constexpr double kUrdfLinearAcceleration = 5;  // [m/s^2]
inline constexpr double kUrdfLinearJerk = 1000;       // [m/s^3]
inline constexpr double kUrdfForceRise = 0.1;         // [s]

// Collision geometry that moves with joint `segment` of the arm (0: with the base), in that link's frame.
struct AttachedShape {
  std::size_t segment = 0;
  // X_SG is the product of one pose of each step, the first step first. Every combination is a place of the
  // shape; a step has at most kMostPoses.
  std::vector<std::vector<Pose>> steps;
  UrdfGeometry shape;
  std::string link;  // by the URDF's name
};
inline constexpr std::size_t kMostPoses = 81;
// All geometry of an arm, link by link, and of everything fixed to the base: also the carrier of base_link,
// but nothing that another joint moves, such as a head or another arm. Bodies moved by joints outside the
// arm, such as fingers, are in three places, with that joint at its lower limit, in the middle and at
// its upper limit, if it has limits and is not held. Throws as robot_from_urdf.
std::vector<AttachedShape> attached_shapes(const std::string& urdf_text, const UrdfChain& chain);

// Resolves "package://NAME/REST" (REST below the folder of that name in the share folders of
// AMENT_PREFIX_PATH, or in the Python environment's example-robot-data), or behind a path, relative to
// `folder`. Throws std::invalid_argument with the places that it searched.
std::filesystem::path urdf_file(const std::string& name, const std::filesystem::path& folder);

// Gives an imported arm capsules around the <collision> geometry of its moving links, at most kMostCapsules
// per link of the arm, each containing what it is fitted to, and its base convex hulls, at most
// kMostBaseHulls for all that is fixed to it. Two arms of one robot have equal ones, which count once
// (core/features/collision_pairs.hpp). Pairs of links, or of a hull and a link, that overlap at home, or in
// more than kOften of random configurations, are ignored: the shapes are wider than the bodies there. A hull
// and a link that are nearer than kClearAtHome at home count as overlapping: collision_avoidance could not be
// switched on there.
// robot.origin["self_collision"] says what was found, how much wider the capsules are, and which pairs are
// ignored, as does robot.unguarded_pairs. Meshes are looked up as
// urdf_file does, from `folder`. Throws std::invalid_argument if a shape cannot be read, because an arm with
// gaps would seem to be protected.
inline constexpr std::size_t kMostCapsules = 3, kMostBaseHulls = 6;
inline constexpr double kOften = 0.3;
inline constexpr double kClearAtHome = 0.02;  // [m]
void fit_collision(const std::string& urdf_text, const UrdfChain& chain, const std::filesystem::path& folder,
                   RobotDescription& robot);

// The meshes of all <collision> geometry of a URDF that exist.
std::vector<std::filesystem::path> mesh_files(const std::filesystem::path& urdf);

}  // namespace multipanda
