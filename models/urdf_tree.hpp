#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/types/spatial.hpp"
#include "models/robot_description.hpp"

// A URDF as plain data: its links' masses and collision geometry, and its joints. Visuals, transmissions,
// sensors and plugins are not read.
namespace multipanda {

struct UrdfMimic {
  std::string joint;  // this joint's position = multiplier * that joint's + offset
  double multiplier = 1;
  double offset = 0;
};

struct UrdfJoint {
  std::string name;
  std::string type;  // "fixed", "revolute", "continuous", "prismatic", "floating", "planar"
  std::string parent, child;
  Pose X_PC;                        // child in parent at zero
  Vector3 axis = Vector3::UnitX();  // in the child's frame, unit length
  std::optional<double> lower,
      upper;                       // [rad] or [m]; none: not in the file, or the joint is continuous
  std::optional<double> velocity;  // [rad/s] or [m/s]
  std::optional<double> effort;    // [N m] or [N]
  double damping = 0;              // [N m s/rad] or [N s/m]
  double friction = 0;             // dry [N m] or [N]
  std::optional<UrdfMimic> mimic;

  bool turns() const { return type == "revolute" || type == "continuous"; }
  bool slides() const { return type == "prismatic"; }
  // Child in parent at `position` [rad] or [m]; a floating or planar joint stays at zero.
  Pose pose_at(double position) const;
};

// A <collision> of a link.
struct UrdfGeometry {
  enum class Kind { box, cylinder, sphere, mesh, unknown };
  Kind kind = Kind::unknown;
  Pose X_LG;                        // in the link
  Vector3 size = Vector3::Zero();   // box: full edge lengths [m]
  double radius = 0, length = 0;    // cylinder (along z), sphere [m]
  std::string file;                 // mesh: as written; unknown shape: the fault
  Vector3 scale = Vector3::Ones();  // mesh
};

struct UrdfTree {
  std::string name;
  std::map<std::string, RigidBody> links;                       // mass 0: none is given
  std::map<std::string, std::vector<UrdfGeometry>> collisions;  // by link
  std::vector<UrdfJoint> joints;                                // in the order of the file

  std::vector<std::string> link_names() const;
  std::vector<std::string> joint_names() const;
  const UrdfJoint* joint(const std::string& name) const;         // nullptr: none
  const UrdfJoint* parent_joint(const std::string& link) const;  // that moves this link; nullptr: the root
  std::vector<const UrdfJoint*> child_joints(const std::string& link) const;
};

// Throws std::invalid_argument with the fault and the link or joint. Also refuses files that are not trees: a
// link with two parents, a joint between missing links, a loop; and sources of xacro, of which a part would
// be missing.
UrdfTree parse_urdf(const std::string& text);

}  // namespace multipanda
