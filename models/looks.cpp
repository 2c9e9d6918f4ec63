#include "models/looks.hpp"

#include <cmath>

namespace multipanda {

Vector3 rpy_of(const Matrix3& R) {
  const double cos_pitch = std::hypot(R(0, 0), R(1, 0));
  const double pitch = std::atan2(-R(2, 0), cos_pitch);
  if (cos_pitch < 1e-9)
    return {std::atan2(-R(1, 2), R(1, 1)), pitch, 0.0};  // only roll -+ yaw is defined: yaw 0
  return {std::atan2(R(2, 1), R(2, 2)), pitch, std::atan2(R(1, 0), R(0, 0))};
}

Shape moved(const Shape& shape, const Pose& X_AB, const std::string& link) {
  Shape result = shape;
  result.link = link;
  result.from = X_AB * shape.from;
  result.to = X_AB * shape.to;
  const Pose center = X_AB * shape.center.pose();
  result.center = {center.position, rpy_of(center.rotation)};
  return result;
}

Pose shape_pose(const Shape& shape) {
  if (shape.kind == ShapeKind::box || shape.kind == ShapeKind::sphere) return shape.center.pose();
  return Pose::from(0.5 * (shape.from + shape.to),
                    Quaternion::FromTwoVectors(Vector3::UnitZ(), shape.to - shape.from));
}

std::vector<Shape> link_visuals(const RobotDescription& robot) {
  if (!robot.visuals.empty()) return robot.visuals;
  std::vector<Shape> shapes;
  for (const auto& capsule : robot.capsules) {
    Shape shape;
    shape.kind = ShapeKind::capsule;
    shape.link = capsule.link;
    shape.from = capsule.from;
    shape.to = capsule.to;
    shape.radius = capsule.radius;
    shape.color = (capsule.link.back() - '0') % 2 == 0 ? "silver" : "white";  // neighbors can be told apart
    shapes.push_back(shape);
  }
  return shapes;
}

std::vector<Shape> closed_hand_visuals(const HandDescription& hand) {
  std::vector<Shape> shapes = hand.visuals;
  const Pose X_HL = hand.finger_mount.pose();
  const Pose half_turn{Vector3(-1, -1, 1).asDiagonal(), Vector3::Zero()};
  for (const auto& shape : hand.finger_visuals) {
    shapes.push_back(moved(shape, X_HL, "hand"));
    shapes.push_back(moved(shape, half_turn * X_HL, "hand"));
  }
  return shapes;
}

}  // namespace multipanda
