#pragma once

#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "models/robot_description.hpp"
#include "yaml_reader/archive.hpp"

// Structures of a model file (docs/models.md) declare their keys here. `n`: number of joints. All
// throw ConfigError.
namespace multipanda {

void visit(Archive& archive, Placement& placement);
void visit(Archive& archive, RigidBody& body);
// `physical`: whether a physically impossible body is refused.
void visit_body(Archive& archive, RigidBody& body, bool physical);
void visit(Archive& archive, Capsule& capsule);
void visit(Archive& archive, Shape& shape);
void visit(Archive& archive, HandDescription& hand);

// Properties of an individual arm rather than its model, from identification.
void visit(Archive& archive, JointFriction& friction, const std::size_t& n);
void visit(Archive& archive, FrictionLaw& law, const std::size_t& n);
void visit(Archive& archive, PreslidingElement& element, const std::size_t& n);
void visit(Archive& archive, TorqueSensor& sensor, const std::size_t& n);
void visit(Archive& archive, Actuation& actuation);
void visit(Archive& archive, IdentifiedRange& range, const std::size_t& n);

// Entries xx, yy, zz, xy, xz, yz of a symmetric matrix. Without `complete`, those off the
// diagonal are optional. Without `physical` those on it may be negative.
void visit_inertia(Archive& archive, Matrix3& I, bool complete, bool physical = true);
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

// Cache of the robots read by this process, with the texts of their files. Reading a robot takes 4 ms,
// comparing the texts 0.1 ms, and building a scene needs it a dozen times. Any thread.
class KnownRobots {
 public:
  // Empty if the robot is unknown or one of its files has changed.
  std::optional<RobotDescription> find(const std::filesystem::path& file);
  void keep(const std::filesystem::path& file, const std::vector<std::filesystem::path>& files,
            const RobotDescription& robot);

 private:
  struct Entry {
    RobotDescription robot;
    std::vector<std::pair<std::filesystem::path, std::string>> texts;
  };
  std::mutex mutex_;
  std::map<std::filesystem::path, Entry> known_;
};

// The cache of this process.
KnownRobots& known_robots();

// Keys of a joint's limits in model files, with their units.
struct LimitKeys {
  const char *lower, *upper, *velocity, *effort;
};
inline constexpr LimitKeys kTurningLimits{"lower_rad", "upper_rad", "velocity_rad_per_s", "effort_nm"};
inline constexpr LimitKeys kSlidingLimits{"lower_m", "upper_m", "velocity_m_per_s", "effort_n"};
constexpr const LimitKeys& limit_keys(bool prismatic) { return prismatic ? kSlidingLimits : kTurningLimits; }

}  // namespace multipanda
