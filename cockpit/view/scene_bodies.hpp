#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "core/features/collision_pairs.hpp"
#include "core/model/model_terms.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"

namespace multipanda::cockpit {

// Drawing data of a scene: rigid bodies made of primitives, and their poses. Bodies come arm by arm (links,
// tool shapes, hand, fingers), then the objects.
class SceneBodies {
 public:
  static constexpr std::size_t kPoseNumbers = 7;  // x y z [m], quaternion w x y z

  // Throws std::invalid_argument.
  explicit SceneBodies(const Scene& scene);

  std::size_t count() const { return bodies_.size(); }
  // List of bodies, with shapes in each body's frame. `poses`: of all bodies, as `place` writes them.
  nlohmann::json describe(std::span<const double> poses) const;

  struct ArmPose {
    ModelTerms* terms = nullptr;  // updated
    double gripper_width = 0;     // NaN: closed [m]
  };
  // Poses of all bodies in the world (kPoseNumbers each). `objects`: of the scene's objects in order; none:
  // as in the scene.
  void place(std::span<const ArmPose> arms, std::span<const std::optional<Pose>> objects,
             std::span<double> out) const;

 private:
  enum class Fixed { base, joint, flange, left_finger, right_finger, object };
  struct Body {
    std::string name, link;
    Fixed to = Fixed::base;
    std::size_t index = 0;  // of the arm, or of the object
    std::size_t joint = 0;  // Fixed::joint
    Pose X;                 // relative to its parent; of an object: in the world
    std::vector<nlohmann::json> shapes;
    bool movable = true;
  };

  void add_arm(const SceneArm& arm, std::size_t index);
  void add_object(const SceneObject& object, std::size_t index);

  std::vector<Body> bodies_;
  std::vector<std::string> arm_names_;
};

// [x, y, z, w, x, y, z]
void write_pose(const Pose& X, double* out);

// The part `arms` of a scene's description (cockpit/WIRE.md): limits, bases and end effectors.
nlohmann::json describe_arms(const Scene& scene);

// Pairs of parts that are close: arms, or an arm and a fixed object of the scene.
class NearPairs {
 public:
  static constexpr double kNear = 0.05;  // [m]
  static constexpr std::size_t kMost = 16;
  static constexpr std::size_t kNumbers = 9;  // distance, from (3), to (3), arm of each (-1: an object)

  // `obstacles` are copied.
  NearPairs(std::vector<std::shared_ptr<const ArmModel>> models, std::vector<Obstacle> obstacles);

  // The closest kMost pairs, sorted; the rest of `out` (kMost * kNumbers) is not a number. `terms`: one per
  // arm, updated.
  void find(std::span<ModelTerms> terms, std::span<double> out);

 private:
  std::vector<std::shared_ptr<const ArmModel>> models_;
  std::vector<Obstacle> obstacles_;
  std::vector<ArmIndex> all_;
  std::unique_ptr<CollisionPairs> pairs_;
};

}  // namespace multipanda::cockpit
