#pragma once

#include <string>
#include <vector>

#include "models/checked_yaml.hpp"
#include "models/robot_description.hpp"

// Pieces of a model file that stand in several of its sections, and the sections about shapes. All throw
// std::invalid_argument with file and line.
namespace multipanda {

JointVector joint_vector(const CheckedYaml& yaml, std::size_t n);
JointVector positive_joint_vector(const CheckedYaml& yaml, std::size_t n);  // each above 0
Placement read_placement(const CheckedYaml& yaml);
RigidBody read_body(const CheckedYaml& yaml);
std::vector<Capsule> read_capsules(const CheckedYaml& yaml, const std::string& link);
std::vector<Shape> read_shapes(const CheckedYaml& yaml, const std::string& link);

// The sections `self_collision` and `hand`. The joints are there already.
void read_self_collision(const CheckedYaml& yaml, RobotDescription& robot);
HandDescription read_hand(const CheckedYaml& yaml);

// "link0" ... "link7"
std::vector<std::string> numbered(const char* stem, std::size_t first, std::size_t last);

}  // namespace multipanda
