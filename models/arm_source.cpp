#include "models/arm_source.hpp"

#include <algorithm>
#include <stdexcept>

#include "models/write_robot.hpp"

namespace multipanda {
namespace {

// Both ends in the frame of the joint, which becomes the shape's frame. The description was checked.
CollisionShape part(const std::string& name, int joint, const Capsule& capsule, const Pose& X_JL) {
  ConvexShape shape;
  shape.kind = ConvexShape::Kind::capsule;
  shape.p0 = X_JL * capsule.from;
  shape.p1 = X_JL * capsule.to;
  shape.radius = capsule.radius;
  // link0 and link1 are mounted on fixed objects of a scene.
  return {name, joint, shape, Pose{}, joint > 0};
}

void add_collision_shapes(const RobotDescription& robot, bool hand, ArmModelSource& source) {
  const int last = static_cast<int>(robot.joint_count()) - 1;
  auto& parts = source.collision_shapes;
  for (std::size_t k = 0; k < robot.base_hulls.size(); ++k) {
    const BaseHull& corners = robot.base_hulls[k];
    if (corners.empty() || corners.size() > kMaxShapeVertices) {
      throw std::invalid_argument("model '" + robot.name + "': the hull " + hull_name(k) +
                                  " of the base has " + std::to_string(corners.size()) +
                                  " corners; expected 1 to " + std::to_string(kMaxShapeVertices) +
                                  ", use fewer corners or split the hull");
    }
    ConvexShape shape;
    shape.kind = ConvexShape::Kind::vertices;
    shape.vertex_count = static_cast<std::uint8_t>(corners.size());
    std::copy(corners.begin(), corners.end(), shape.vertex.begin());
    parts.push_back({hull_name(k), -1, shape, Pose{}, false});
  }
  for (int link = 0; link <= last + 1; ++link) {
    const std::string name = "link" + std::to_string(link);
    for (const auto& capsule : robot.capsules) {
      if (capsule.link == name) parts.push_back(part(name, link - 1, capsule, {}));
    }
  }
  if (hand) {
    const Pose X_JH = robot.flange.pose() * robot.hand->mount.pose();
    for (const auto& capsule : robot.hand->palm_capsules) parts.push_back(part("hand", last, capsule, X_JH));
    for (const auto& capsule : robot.hand->finger_capsules) {
      parts.push_back(part("hand", last, capsule, X_JH));
    }
  }
  for (std::size_t a = 0; a < parts.size(); ++a) {
    for (std::size_t b = a + 1; b < parts.size(); ++b) {
      if (!is_ignored_pair(robot, parts[a].name, parts[b].name)) source.self_pairs.emplace_back(a, b);
    }
  }
}

}  // namespace

ArmModelSource arm_model_source(const RobotDescription& robot, const Pose& X_WB, bool hand) {
  ArmModelSource source;
  source.name = robot.name;
  source.urdf = to_urdf(robot, {.hand = hand, .geometry = false});
  source.flange = "flange";
  source.X_WB = X_WB;
  source.limits.q_min = robot.limits.q_min;
  source.limits.q_max = robot.limits.q_max;
  source.limits.dq_max = robot.limits.dq_max;
  source.limits.ddq_max = robot.limits.ddq_max;
  source.limits.tau_max = robot.limits.tau_max;
  source.limits.tau_rate_max = robot.limits.tau_rate_max;
  source.limits.velocity_by_position = robot.position_based_velocity;
  source.q_home = robot.q_home;
  add_collision_shapes(robot, hand, source);
  return source;
}

}  // namespace multipanda
