#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/controllets/controllet.hpp"
#include "core/features/feature.hpp"
#include "core/geometry/shape.hpp"

namespace multipanda {

// The pairs of shapes that concern some arms of a scene (`own`), and their distances:
//   - an own arm with itself: the pairs of its model (ArmModel::self_pairs),
//   - an own arm with any other arm, of any owner: all pairs in which either shape can move; a base
//     that both have (equal shapes at the same place) counts only as each arm's own,
//   - an own arm's moving shapes with the obstacles.
// Shapes are placed in the world once per cycle. Built before the loop; nothing allocates afterwards.
class CollisionPairs {
 public:
  static constexpr ArmIndex kNoArm = static_cast<ArmIndex>(-1);
  // A shape of an arm, or an obstacle.
  struct Body {
    ArmIndex arm = kNoArm;
    int joint = -1;  // joint that moves it; -1: fixed
    ConvexShape shape;
    Pose X_JS;                // in the frame of that joint, or in the world if fixed; segments: identity
    BoundingSphere sphere;    // in the shape's frame
    bool is_segment = false;  // sphere or capsule
    bool half_space = false;
    Pose X_WS;                                           // in this cycle
    Vector3 p0 = Vector3::Zero(), p1 = Vector3::Zero();  // in this cycle: a segment's ends in the world
    std::string name;                                    // for messages: "link5 of arm 'left'"
  };
  struct Pair {
    std::uint16_t a = 0, b = 0;  // bodies
  };

  // Throws std::invalid_argument if there are more than 65535 shapes.
  explicit CollisionPairs(const FeatureContext& context);

  std::size_t size() const { return pairs_.size(); }
  const Pair& pair(std::size_t i) const { return pairs_[i]; }
  const Body& body(std::size_t i) const { return bodies_[i]; }

  // Updates the poses of all shapes and obstacles for this cycle. The shapes of an arm whose joint positions
  // are not finite stay where they were last; at_least() of those that never had a place is not a number.
  void place(std::span<OwnedArm> scene_arms);
  // Whether one of them is a hull around the base of an arm.
  bool has_base_hull(std::size_t i) const { return is_base_hull(pairs_[i].a) || is_base_hull(pairs_[i].b); }
  // A lower bound of the distance, from the bounding spheres.
  double at_least(std::size_t i) const {
    const Sphere &a = spheres_[pairs_[i].a], &b = spheres_[pairs_[i].b];
    if (b.radius >= 0) return (a.center - b.center).norm() - a.radius - b.radius;
    return b.center.dot(a.center) - b.offset - a.radius;
  }
  // Distance and closest points, in the world.
  Closest closest(std::size_t i) const;
  // The same with points that move continuously (core/geometry/shape.hpp), from the result of
  // closest(). Its distance is at most kMostLowered smaller.
  static constexpr double kMostLowered = 3 * kEven;  // of a box above a half space
  Closest smooth(std::size_t i, const Closest& exact) const;

 private:
  // Bounding sphere in the world. For a half space: radius -1, and its normal as the center.
  struct Sphere {
    Vector3 center = Vector3::Zero();
    double radius = 0;
    double offset = 0;  // half space: normal . p for the points of its plane
  };
  void add(ArmIndex arm, int joint, const ConvexShape& shape, const Pose& X_JS);
  bool is_base_hull(std::size_t i) const {
    const Body& body = bodies_[i];
    return body.joint < 0 && body.arm != kNoArm && body.shape.kind == ConvexShape::Kind::vertices;
  }
  void fix(Body& body, const ConvexShape& shape, const Pose& X_JS);
  void place(std::size_t body, const Pose& X_WJ);
  void place_obstacles();

  std::vector<Body> bodies_;     // arm by arm, then obstacles
  std::vector<Sphere> spheres_;  // of each body
  std::vector<Pair> pairs_;
  std::vector<std::size_t> moving_;  // bodies in some pair that a joint moves
  // Those of the scene are the last bodies, in the same order.
  std::span<const Obstacle> obstacles_;
  std::vector<Pose> X_WO_;  // present poses of those bodies
};

}  // namespace multipanda
