#pragma once

#include <string>
#include <vector>

#include "config_file/archive.hpp"
#include "models/robot_description.hpp"

// Structures of a model file (docs/models.md) declare their keys here. `n`: number of joints.
// All throw ConfigError.
namespace multipanda {

void visit(Archive& archive, Placement& placement);
void visit(Archive& archive, RigidBody& body);
void visit(Archive& archive, Capsule& capsule);
void visit(Archive& archive, Shape& shape);
void visit(Archive& archive, HandDescription& hand);

// Properties of an individual arm rather than of its model, as found by identification.
void visit(Archive& archive, JointFriction& friction, const std::size_t& n);
void visit(Archive& archive, FrictionLaw& law, const std::size_t& n);
void visit(Archive& archive, PreslidingElement& element, const std::size_t& n);
void visit(Archive& archive, TorqueSensor& sensor, const std::size_t& n);
void visit(Archive& archive, Actuation& actuation);

// Entries xx, yy, zz, xy, xz, yz of a symmetric matrix. Without `complete`, those off the
// diagonal are optional.
void visit_inertia(Archive& archive, Matrix3& I, bool complete);
void read_self_collision(const Node& node, RobotDescription& robot);
// "link0", ..., "link7"
std::vector<std::string> numbered(const char* stem, std::size_t first, std::size_t last);
// One number per joint, checked by the key.
JointVector read_joint_vector(const Node& node, Key key, std::size_t n);
// The frame that a shape of a list belongs to.
template <typename T>
std::vector<T> on_link(std::vector<T> shapes, const std::string& link) {
  for (auto& shape : shapes) shape.link = link;
  return shapes;
}

}  // namespace multipanda
