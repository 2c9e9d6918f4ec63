#include "cockpit/view/scene_bodies.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include <nlohmann/json.hpp>

#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"
#include "models/robot_description.hpp"
#include "scene/build.hpp"

namespace multipanda::cockpit {

namespace {

using nlohmann::json;

json numbers(const Vector3& v) { return {v.x(), v.y(), v.z()}; }
json numbers(const Quaternion& q) { return {q.w(), q.x(), q.y(), q.z()}; }
json numbers(const JointVector& v) { return std::vector<double>(v.data(), v.data() + v.size()); }

constexpr std::array<double, 4> kToolColor{0.45, 0.47, 0.5, 1};

json shape(const char* kind, json size, const Pose& X, const json& rgba) {
  return {{"kind", kind},
          {"size_m", std::move(size)},
          {"position_m", numbers(X.position)},
          {"quaternion_wxyz", numbers(X.quaternion())},
          {"color_rgba", rgba}};
}

// A shape of a robot's model.
json shape(const Shape& part) {
  const Vector3 color =
      shape_colors().contains(part.color) ? shape_colors().at(part.color) : Vector3::Constant(0.8);
  const json rgba = {color.x(), color.y(), color.z(), 1};
  const double length = (part.to - part.from).norm();
  const Pose X = shape_pose(part);
  switch (part.kind) {
    case ShapeKind::capsule:
      return shape("capsule", {part.radius, length}, X, rgba);
    case ShapeKind::cylinder:
      return shape("cylinder", {part.radius, length}, X, rgba);
    case ShapeKind::sphere:
      return shape("sphere", json::array({part.radius}), X, rgba);
    case ShapeKind::box:
      break;
  }
  return shape("box", numbers(part.size), X, rgba);
}

// A shape of a scene, with a size as SceneObject::size.
json shape(ShapeType type, const Vector3& size, const Pose& X, const json& rgba) {
  switch (type) {
    case ShapeType::plane:
      return shape("plane", json::array(), X, rgba);
    case ShapeType::sphere:
      return shape("sphere", json::array({0.5 * size.x()}), X, rgba);
    case ShapeType::cylinder:
      return shape("cylinder", {0.5 * size.x(), size.z()}, X, rgba);
    case ShapeType::capsule:
      return shape("capsule", {0.5 * size.x(), size.z()}, X, rgba);
    case ShapeType::box:
      break;
  }
  return shape("box", numbers(size), X, rgba);
}

// The right finger is the left one turned about the hand's z axis.
Pose half_turn() { return Pose::from(Vector3::Zero(), Quaternion(0, 0, 0, 1)); }

}  // namespace

void write_pose(const Pose& X, double* out) { std::ranges::copy(X.values(), out); }

SceneBodies::SceneBodies(const Scene& scene) {
  for (std::size_t i = 0; i < scene.arms.size(); ++i) add_arm(scene.arms[i], i);
  for (std::size_t i = 0; i < scene.objects.size(); ++i) add_object(scene.objects[i], i);
}

void SceneBodies::add_arm(const SceneArm& arm, std::size_t index) {
  arm_names_.push_back(arm.name);
  const RobotDescription robot = robot_of(arm);
  const auto visuals = link_visuals(robot);
  for (std::size_t link = 0; link <= robot.joint_count(); ++link) {
    Body body{.name = arm.name + "/link" + std::to_string(link),
              .link = "link" + std::to_string(link),
              .to = link == 0 ? Fixed::base : Fixed::joint,
              .index = index,
              .joint = link == 0 ? 0 : link - 1};
    for (const Shape& part : visuals) {
      if (part.link == body.link) body.shapes.push_back(shape(part));
    }
    body.movable = link > 0;
    bodies_.push_back(std::move(body));
  }
  if (!arm.tool_shapes.empty()) {
    Body tool{.name = arm.name + "/tool", .link = "tool", .to = Fixed::flange, .index = index};
    for (const ToolShape& part : arm.tool_shapes)
      tool.shapes.push_back(shape(part.shape, part.size, part.X_FS, kToolColor));
    bodies_.push_back(std::move(tool));
  }
  if (!arm.hand || arm.vacuum || !robot.hand) return;
  const HandDescription& hand = *robot.hand;
  const Pose X_FH = hand.mount.pose(), X_HL = hand.finger_mount.pose();
  Body palm{.name = arm.name + "/hand", .link = "hand", .to = Fixed::flange, .index = index, .X = X_FH};
  for (const Shape& part : hand.visuals) palm.shapes.push_back(shape(part));
  Body left{.name = arm.name + "/left_finger",
            .link = "left_finger",
            .to = Fixed::left_finger,
            .index = index,
            .X = X_FH * X_HL};
  for (const Shape& part : hand.finger_visuals.empty() ? hand.finger_boxes : hand.finger_visuals)
    left.shapes.push_back(shape(part));
  Body right = left;
  right.name = arm.name + "/right_finger";
  right.link = "right_finger";
  right.to = Fixed::right_finger;
  right.X = X_FH * half_turn() * X_HL;
  for (Body* body : {&palm, &left, &right}) bodies_.push_back(std::move(*body));
}

void SceneBodies::add_object(const SceneObject& object, std::size_t index) {
  Body body{.name = object.name, .link = "", .to = Fixed::object, .index = index, .X = object.X_WO};
  body.movable = !object.fixed;
  body.shapes.push_back(shape(object.shape, object.size, Pose{}, object.rgba));
  bodies_.push_back(std::move(body));
}

json SceneBodies::describe(std::span<const double> poses) const {
  json all = json::array();
  for (std::size_t i = 0; i < bodies_.size(); ++i) {
    const Body& body = bodies_[i];
    const auto pose = poses.subspan(kPoseNumbers * i, kPoseNumbers);
    json entry = {{"name", body.name},
                  {"movable", body.movable},
                  {"position_m", std::vector(pose.begin(), pose.begin() + 3)},
                  {"quaternion_wxyz", std::vector(pose.begin() + 3, pose.end())},
                  {"shapes", body.shapes}};
    if (body.to == Fixed::object) {
      entry["object"] = body.name;
    } else {
      entry["arm"] = arm_names_[body.index];
      entry["link"] = body.link;
    }
    all.push_back(std::move(entry));
  }
  return all;
}

void SceneBodies::place(std::span<const ArmPose> arms, std::span<const std::optional<Pose>> objects,
                        std::span<double> out) const {
  double* at = out.data();
  for (const Body& body : bodies_) {
    Pose X = body.X;
    if (body.to == Fixed::object) {
      if (body.index < objects.size() && objects[body.index]) X = *objects[body.index];
    } else {
      const ArmPose& arm = arms[body.index];
      const double width = std::isfinite(arm.gripper_width) ? arm.gripper_width : 0;
      switch (body.to) {
        case Fixed::base:
          X = arm.terms->model().X_WB();
          break;
        case Fixed::joint:
          X = arm.terms->X_WJ(body.joint);
          break;
        case Fixed::left_finger:
        case Fixed::right_finger:
          X.position += X.rotation.col(1) * (0.5 * width);
          [[fallthrough]];
        default:
          X = arm.terms->X_WF() * X;
      }
    }
    write_pose(X, at);
    at += kPoseNumbers;
  }
}

using nlohmann::json;

json describe_arms(const Scene& scene) {
  json arms = json::array();
  for (const SceneArm& arm : scene.arms) {
    const RobotDescription robot = robot_of(arm);
    const ArmLimits& limits = arm.safety.joints;
    const Pose X_FE = arm_config(arm).frames.X_FE;
    json entry = {{"name", arm.name},
                  {"model", robot.name},
                  {"title", robot.title},
                  {"joints", robot.joint_count()},
                  {"base_position_m", numbers(arm.X_WB.position)},
                  {"base_quaternion_wxyz", numbers(arm.X_WB.quaternion())},
                  {"q_min_rad", numbers(limits.q_min)},
                  {"q_max_rad", numbers(limits.q_max)},
                  {"dq_max_rad_per_s", numbers(limits.dq_max)},
                  {"tau_max_nm", numbers(limits.tau_max)},
                  {"q_home_rad", numbers(robot.q_home)},
                  {"end_effector",
                   {{"position_m", numbers(X_FE.position)}, {"quaternion_wxyz", numbers(X_FE.quaternion())}}},
                  {"workspace", nullptr}};
    if (const auto& box = arm.safety.workspace)
      entry["workspace"] = {{"min_m", numbers(box->min)}, {"max_m", numbers(box->max)}};
    arms.push_back(std::move(entry));
  }
  return arms;
}

NearPairs::NearPairs(std::vector<std::shared_ptr<const ArmModel>> models, std::vector<Obstacle> obstacles)
    : models_(std::move(models)), obstacles_(std::move(obstacles)), all_(models_.size()) {
  std::iota(all_.begin(), all_.end(), ArmIndex{0});
  pairs_ = std::make_unique<CollisionPairs>(
      FeatureContext{.arms = models_, .own = all_, .obstacles = obstacles_, .friction_compensated = {}});
}

void NearPairs::find(std::span<ModelTerms> terms, std::span<double> out) {
  std::ranges::fill(out, std::numeric_limits<double>::quiet_NaN());
  std::vector<OwnedArm> arms(terms.size());
  for (std::size_t i = 0; i < terms.size(); ++i) arms[i].terms = &terms[i];
  pairs_->place(arms);
  struct Found {
    double distance;
    std::size_t pair;
    Closest closest;
  };
  std::vector<Found> found;
  for (std::size_t i = 0; i < pairs_->size(); ++i) {
    if (!(pairs_->at_least(i) < kNear)) continue;
    const Closest closest = pairs_->closest(i);
    if (closest.distance < kNear) found.push_back({closest.distance, i, closest});
  }
  std::ranges::sort(found, {}, &Found::distance);
  double* at = out.data();
  for (std::size_t k = 0; k < std::min(found.size(), kMost); ++k) {
    const auto& [distance, index, closest] = found[k];
    const auto arm_of = [&](std::uint16_t body) {
      const ArmIndex arm = pairs_->body(body).arm;
      return arm == CollisionPairs::kNoArm ? -1.0 : static_cast<double>(arm);
    };
    const auto& pair = pairs_->pair(index);
    const Vector3 &a = closest.p_A, &b = closest.p_B;
    for (const double value :
         {distance, a.x(), a.y(), a.z(), b.x(), b.y(), b.z(), arm_of(pair.a), arm_of(pair.b)})
      *at++ = value;
  }
}

}  // namespace multipanda::cockpit
