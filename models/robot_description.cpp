#include "models/robot_description.hpp"

#include <algorithm>

#include "support/own_files.hpp"

namespace multipanda {
namespace {

const Pose kHalfTurnAboutZ{Vector3(-1, -1, 1).asDiagonal(), Vector3::Zero()};

std::size_t link_index(const std::string& link, std::size_t joint_count) {
  return link == "hand" ? joint_count + 1 : std::stoul(link.substr(4));
}

}  // namespace

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
  if (robot.motor_inertia.size() > 0) return robot.motor_inertia;
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

}  // namespace multipanda
