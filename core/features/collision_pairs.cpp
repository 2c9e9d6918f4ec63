#include "core/features/collision_pairs.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace multipanda {

using Kind = ConvexShape::Kind;

namespace {

// Two bodies of bases, both in the world.
bool coincide(const CollisionPairs::Body& a, const CollisionPairs::Body& b) {
  constexpr double kSame = 1e-6;  // [m]
  const ConvexShape &one = a.shape, &other = b.shape;
  if (one.kind != other.kind || std::abs(one.radius - other.radius) > kSame) return false;
  if (a.is_segment) {
    const auto far = [](const Vector3& p, const Vector3& q) { return (p - q).norm() > kSame; };
    return !far(one.p0, other.p0) && (one.kind == Kind::sphere || !far(one.p1, other.p1));
  }
  if (one.kind == Kind::vertices) {
    if (one.vertex_count != other.vertex_count) return false;
    for (std::size_t i = 0; i < one.vertex_count; ++i) {
      if ((a.X_JS * one.vertex[i] - b.X_JS * other.vertex[i]).norm() > kSame) return false;
    }
    return true;
  }
  return (one.half - other.half).norm() <= kSame && (a.X_JS.position - b.X_JS.position).norm() <= kSame &&
         (a.X_JS.rotation - b.X_JS.rotation).norm() <= kSame;
}

}  // namespace

CollisionPairs::CollisionPairs(const FeatureContext& context) : obstacles_(context.obstacles) {
  ArmSet own;
  for (const ArmIndex arm : context.own) own |= ArmSet::of(arm);
  std::vector<std::size_t> first;  // body of each arm, then of the obstacles
  for (ArmIndex arm = 0; arm < context.arms.size(); ++arm) {
    first.push_back(bodies_.size());
    const ArmModel& model = *context.arms[arm];
    for (const auto& part : model.collision_shapes()) {
      add(arm, part.joint, part.shape, part.joint < 0 ? model.X_WB() * part.X_JS : part.X_JS);
      bodies_.back().name = part.name + " of arm '" + model.name() + "'";
    }
  }
  first.push_back(bodies_.size());
  for (const auto& obstacle : obstacles_) {
    add(kNoArm, -1, obstacle.shape, obstacle.X_WO);
    bodies_.back().name = "'" + obstacle.name + "'";
    X_WO_.push_back(obstacle.X_WO);
  }
  if (bodies_.size() > std::numeric_limits<std::uint16_t>::max()) {
    throw std::invalid_argument("collision avoidance supports at most 65535 shapes; the scene has " +
                                std::to_string(bodies_.size()));
  }

  // A base shape that another arm has at the same place is the same body, of two arms of one robot. The model
  // of that arm defines which of its links are checked against it.
  const auto is_base_of = [&](std::size_t body, ArmIndex other) {
    if (bodies_[body].joint >= 0) return false;
    for (std::size_t i = first[other]; i < first[other + 1]; ++i) {
      if (bodies_[i].joint < 0 && coincide(bodies_[i], bodies_[body])) return true;
    }
    return false;
  };
  std::vector<bool> used(bodies_.size(), false);
  const auto pair = [&](std::size_t a, std::size_t b) {
    pairs_.push_back({static_cast<std::uint16_t>(a), static_cast<std::uint16_t>(b)});
    used[a] = used[b] = true;
  };
  for (ArmIndex arm = 0; arm < context.arms.size(); ++arm) {
    if (!own.contains(arm)) continue;
    for (const auto& [a, b] : context.arms[arm]->self_pairs()) pair(first[arm] + a, first[arm] + b);
    for (ArmIndex other = 0; other < context.arms.size(); ++other) {
      if (other == arm || (own.contains(other) && other < arm)) continue;  // count a pair of own arms once
      for (std::size_t a = first[arm]; a < first[arm + 1]; ++a) {
        for (std::size_t b = first[other]; b < first[other + 1]; ++b) {
          // The own arm cannot move this shape; the feature of the other arm handles the pair.
          const bool helps = bodies_[a].joint >= 0 || (own.contains(other) && bodies_[b].joint >= 0);
          if (helps && !is_base_of(a, other) && !is_base_of(b, arm)) pair(a, b);
        }
      }
    }
    const auto& parts = context.arms[arm]->collision_shapes();
    for (std::size_t k = 0; k < parts.size(); ++k) {
      if (!parts[k].scene || parts[k].joint < 0) continue;
      for (std::size_t b = first.back(); b < bodies_.size(); ++b) pair(first[arm] + k, b);
    }
  }
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    if (used[i] && bodies_[i].joint >= 0) moving_.push_back(i);
  }
}

void CollisionPairs::add(ArmIndex arm, int joint, const ConvexShape& shape, const Pose& X_JS) {
  Body body;
  body.arm = arm;
  body.joint = joint;
  body.is_segment = shape.kind == Kind::capsule || shape.kind == Kind::sphere;
  body.half_space = shape.kind == Kind::half_space;
  fix(body, shape, X_JS);
  body.sphere = bounding_sphere(body.shape);
  bodies_.push_back(body);
  spheres_.push_back({});
  place(bodies_.size() - 1, Pose{});  // final, if the body is fixed
  if (joint >= 0) spheres_.back().center.setConstant(std::numeric_limits<double>::quiet_NaN());
}

// Where the body is in the frame of its joint, or in the world.
void CollisionPairs::fix(Body& body, const ConvexShape& shape, const Pose& X_JS) {
  body.shape = shape;
  body.X_JS = X_JS;
  if (!body.is_segment) return;
  // Stored in the joint's frame, which saves a transform per cycle.
  body.shape.p0 = X_JS * shape.p0;
  body.shape.p1 = X_JS * shape.p1;
  body.X_JS = {};
}

void CollisionPairs::place(std::size_t i, const Pose& X_WJ) {
  Body& body = bodies_[i];
  Sphere& sphere = spheres_[i];
  sphere.radius = body.sphere.radius;
  if (body.is_segment) {
    body.p0 = X_WJ * body.shape.p0;
    body.p1 = X_WJ * body.shape.p1;
    sphere.center = 0.5 * (body.p0 + body.p1);
    body.X_WS = X_WJ;
    return;
  }
  body.X_WS = X_WJ * body.X_JS;
  if (body.half_space) {
    sphere = {body.X_WS.rotation.col(2), -1, body.X_WS.rotation.col(2).dot(body.X_WS.position)};
  } else {
    sphere.center = body.X_WS * body.sphere.center;
  }
}

void CollisionPairs::place_obstacles() {
  const std::size_t first = bodies_.size() - obstacles_.size();
  for (std::size_t i = 0; i < obstacles_.size(); ++i) {
    const Obstacle& obstacle = obstacles_[i];
    Pose& known = X_WO_[i];
    if (obstacle.X_WO.position == known.position && obstacle.X_WO.rotation == known.rotation) continue;
    known = obstacle.X_WO;
    fix(bodies_[first + i], obstacle.shape, known);
    place(first + i, Pose{});
  }
}

void CollisionPairs::place(std::span<OwnedArm> scene_arms) {
  place_obstacles();
  ArmIndex arm = kNoArm;
  int joint = -1;
  Pose X_WJ;
  bool known = false;
  for (const std::size_t i : moving_) {
    const Body& body = bodies_[i];
    if (body.arm != arm || body.joint != joint) {
      if (body.arm != arm) known = scene_arms[body.arm].terms->q().allFinite();
      arm = body.arm;
      joint = body.joint;
      if (known) X_WJ = scene_arms[arm].terms->X_WJ(static_cast<std::size_t>(joint));
    }
    if (known) place(i, X_WJ);
  }
}

Closest CollisionPairs::closest(std::size_t i) const {
  const Body &a = bodies_[pairs_[i].a], &b = bodies_[pairs_[i].b];
  if (a.is_segment && b.is_segment) {
    return closest_capsules(a.p0, a.p1, a.shape.radius, b.p0, b.p1, b.shape.radius);
  }
  if (a.is_segment && b.half_space) {
    return closest_capsule_half_space(a.p0, a.p1, a.shape.radius, b.X_WS.position, b.X_WS.rotation.col(2));
  }
  return closest_points(a.shape, a.X_WS, b.shape, b.X_WS);
}

Closest CollisionPairs::smooth(std::size_t i, const Closest& exact) const {
  const Body &a = bodies_[pairs_[i].a], &b = bodies_[pairs_[i].b];
  if (a.is_segment && b.is_segment) {
    return smooth_capsules(a.p0, a.p1, a.shape.radius, b.p0, b.p1, b.shape.radius, exact);
  }
  if (a.is_segment && b.half_space) {
    return smooth_capsule_half_space(a.p0, a.p1, a.shape.radius, b.X_WS.position, b.X_WS.rotation.col(2));
  }
  return smooth_points(a.shape, a.X_WS, b.shape, b.X_WS, exact);
}

}  // namespace multipanda
