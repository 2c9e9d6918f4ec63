#include "models/robot_description.hpp"

#include <algorithm>

#include <Eigen/Eigenvalues>

#include "common/own_files.hpp"
#include "core/types/rotation_between.hpp"

namespace multipanda {
namespace {

// Inertia of a point of mass m at r about the origin (parallel axis theorem).
Matrix3 point_inertia(double mass, const Vector3& r) {
  return mass * (r.squaredNorm() * Matrix3::Identity() - r * r.transpose());
}

const Pose kHalfTurnAboutZ{Vector3(-1, -1, 1).asDiagonal(), Vector3::Zero()};

std::size_t link_index(const std::string& link, std::size_t joint_count) {
  return link == "hand" ? joint_count + 1 : std::stoul(link.substr(4));
}

}  // namespace

RigidBody moved(const RigidBody& body, const Pose& X_AB) {
  return {body.mass, X_AB * body.com, X_AB.rotation * body.inertia * X_AB.rotation.transpose()};
}

RigidBody merged(const RigidBody& a, const RigidBody& b) {
  RigidBody sum;
  sum.mass = a.mass + b.mass;
  sum.com = (a.mass * a.com + b.mass * b.com) / sum.mass;
  sum.inertia =
      a.inertia + point_inertia(a.mass, a.com - sum.com) + b.inertia + point_inertia(b.mass, b.com - sum.com);
  return sum;
}

bool is_physical(const RigidBody& body) {
  const Matrix3 second_moment = 0.5 * body.inertia.trace() * Matrix3::Identity() - body.inertia;
  const Eigen::SelfAdjointEigenSolver<Matrix3> solver(second_moment, Eigen::EigenvaluesOnly);
  return body.mass > 0 && solver.eigenvalues().minCoeff() > 0;
}

Pose Placement::pose() const {
  const Quaternion q = Eigen::AngleAxisd(rpy.z(), Vector3::UnitZ()) *
                       Eigen::AngleAxisd(rpy.y(), Vector3::UnitY()) *
                       Eigen::AngleAxisd(rpy.x(), Vector3::UnitX());
  return Pose::from(position, q);
}

bool RobotDescription::has_prismatic_joints() const {
  return std::find(prismatic.begin(), prismatic.end(), true) != prismatic.end();
}

JointVector acting_motor_inertia(const RobotDescription& robot, double hidden) {
  if (robot.motor_inertia.size() > 0)
    return robot.motor_inertia.isZero(0) ? JointVector() : robot.motor_inertia;
  if (robot.rotor_inertia.size() == 0 || hidden >= 1) return {};
  return (1 - hidden) * robot.rotor_inertia;
}

RigidBody rigid_hand(const HandDescription& hand) {
  const Pose X_HL = hand.finger_mount.pose();
  const RigidBody left = moved(hand.finger, X_HL);
  const RigidBody right = moved(hand.finger, kHalfTurnAboutZ * X_HL);
  return merged(hand.body, merged(left, right));
}

std::string hull_name(std::size_t k) { return "link0." + std::to_string(k + 1); }

bool is_ignored_pair(const RobotDescription& robot, const std::string& a, const std::string& b) {
  const auto i = link_index(a, robot.joint_count());
  const auto j = link_index(b, robot.joint_count());
  if ((i > j ? i - j : j - i) <= 1) return true;
  return std::any_of(robot.ignored_pairs.begin(), robot.ignored_pairs.end(), [&](const auto& pair) {
    return (pair.first == a && pair.second == b) || (pair.first == b && pair.second == a);
  });
}

std::filesystem::path models_folder() { return share_folder() / "models"; }

std::vector<std::string> available_robots() {
  std::vector<std::string> names;
  std::error_code missing;
  for (const auto& entry : std::filesystem::directory_iterator(models_folder(), missing)) {
    if (entry.path().extension() == ".yaml") names.push_back(entry.path().stem().string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

const std::map<std::string, Vector3>& shape_colors() {
  static const std::map<std::string, Vector3> colors{
      {"white", {0.93, 0.94, 0.95}}, {"silver", {0.68, 0.70, 0.72}}, {"gray", {0.34, 0.36, 0.39}},
      {"dark", {0.13, 0.14, 0.16}},  {"blue", {0.20, 0.52, 0.86}},   {"green", {0.20, 0.72, 0.45}}};
  return colors;
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
  return Pose::from(0.5 * (shape.from + shape.to), rotation_between(Vector3::UnitZ(), shape.to - shape.from));
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
    shape.color = (capsule.link.back() - '0') % 2 == 0 ? "silver" : "white";  // so that neighbors can be
                                                                              // distinguished
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
