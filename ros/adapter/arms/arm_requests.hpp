#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <multipanda_msgs/srv/set_cartesian_stiffness.hpp>
#include <multipanda_msgs/srv/set_collision_behavior.hpp>
#include <multipanda_msgs/srv/set_guiding_mode.hpp>
#include <multipanda_msgs/srv/set_joint_stiffness.hpp>
#include <multipanda_msgs/srv/set_load.hpp>
#include <multipanda_msgs/srv/set_stiffness_frame.hpp>
#include <multipanda_msgs/srv/set_tool_frame.hpp>
#include <multipanda_msgs/srv/vacuum_drop.hpp>
#include <multipanda_msgs/srv/vacuum_on.hpp>
#include <span>
#include <stdexcept>
#include <string>

#include <fmt/format.h>

#include "core/cycle/backend.hpp"

// Conversions of service messages to requests to an arm of n joints. They check what is specific to messages
// (sizes, quaternions); the backend refuses what the arm does not accept. All throw std::invalid_argument.
namespace multipanda::ros {

inline JointVector joint_values(std::span<const double> values, std::size_t n, const char* what) {
  if (values.size() != n)
    throw std::invalid_argument(
        fmt::format("{}: expected {} values, one per joint, base first; found {}", what, n, values.size()));
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(n));
}

inline Vector6 vector6(const std::array<double, 6>& values) {
  return Eigen::Map<const Vector6>(values.data());
}

// Returns a pose of finite numbers; the quaternion's length must be 1 within 1 %. `what`: name in refusals.
inline Pose read_pose(const geometry_msgs::msg::Pose& pose, const std::string& what) {
  const Vector3 p(pose.position.x, pose.position.y, pose.position.z);
  const Quaternion q(pose.orientation.w, pose.orientation.x, pose.orientation.y, pose.orientation.z);
  if (!p.allFinite() || !q.coeffs().allFinite())
    throw std::invalid_argument(what + ": a value is not finite");
  if (std::abs(q.norm() - 1) > 0.01)
    throw std::invalid_argument(
        fmt::format("{}: expected a quaternion of length 1 (w = 1 for no rotation), its length is {:.4g}",
                    what, q.norm()));
  return Pose::from(p, q);
}

inline ArmRequest read_request(const multipanda_msgs::srv::SetLoad::Request& request, std::size_t /*n*/) {
  SetLoad out;
  out.load.mass = request.mass;
  out.load.p_FC = Eigen::Map<const Vector3>(request.center_of_mass.data());
  // A symmetric matrix is the same row-major and column-major; the backend refuses others.
  out.load.inertia_C = Eigen::Map<const Matrix3>(request.load_inertia.data());
  return out;
}

inline ArmRequest read_request(const multipanda_msgs::srv::SetToolFrame::Request& request,
                               std::size_t /*n*/) {
  return SetFrames{read_pose(request.pose, "X_FE"), {}};
}

inline ArmRequest read_request(const multipanda_msgs::srv::SetStiffnessFrame::Request& request,
                               std::size_t /*n*/) {
  return SetFrames{{}, read_pose(request.pose, "X_EK")};
}

inline ArmRequest read_request(const multipanda_msgs::srv::SetCollisionBehavior::Request& r, std::size_t n) {
  SetCollisionThresholds out;
  out.nominal = {
      .torque_lower = joint_values(r.lower_torque_thresholds_nominal, n, "lower_torque_thresholds_nominal"),
      .torque_upper = joint_values(r.upper_torque_thresholds_nominal, n, "upper_torque_thresholds_nominal"),
      .wrench_lower = vector6(r.lower_force_thresholds_nominal),
      .wrench_upper = vector6(r.upper_force_thresholds_nominal)};
  if (!r.lower_torque_thresholds_acceleration.empty() || !r.upper_torque_thresholds_acceleration.empty()) {
    out.acceleration = {.torque_lower = joint_values(r.lower_torque_thresholds_acceleration, n,
                                                     "lower_torque_thresholds_acceleration"),
                        .torque_upper = joint_values(r.upper_torque_thresholds_acceleration, n,
                                                     "upper_torque_thresholds_acceleration"),
                        .wrench_lower = vector6(r.lower_force_thresholds_acceleration),
                        .wrench_upper = vector6(r.upper_force_thresholds_acceleration)};
  }
  return out;
}

inline ArmRequest read_request(const multipanda_msgs::srv::SetJointStiffness::Request& request,
                               std::size_t n) {
  return SetJointStiffness{joint_values(request.joint_stiffness, n, "joint_stiffness")};
}

inline ArmRequest read_request(const multipanda_msgs::srv::SetCartesianStiffness::Request& request,
                               std::size_t /*n*/) {
  return SetCartesianStiffness{vector6(request.cartesian_stiffness)};
}

inline ArmRequest read_request(const multipanda_msgs::srv::SetGuidingMode::Request& request,
                               std::size_t /*n*/) {
  return SetGuidingMode{.axes = request.axes, .elbow = static_cast<bool>(request.elbow)};
}

inline GripperRequest read_request(const multipanda_msgs::srv::VacuumOn::Request& request) {
  return VacuumOn{request.vacuum_mbar, request.timeout};
}

inline GripperRequest read_request(const multipanda_msgs::srv::VacuumDrop::Request& request) {
  return VacuumDrop{request.timeout};
}

// Refuses a lower threshold above its upper one: contact would not be reported before the arm stops.
inline void refuse_unordered(const SetCollisionThresholds& asked) {
  for (const auto& set : {asked.nominal, asked.acceleration.value_or(asked.nominal)}) {
    if ((set.torque_lower.array() <= set.torque_upper.array()).all() &&
        (set.wrench_lower.array() <= set.wrench_upper.array()).all())
      continue;
    throw std::invalid_argument("a lower threshold is above its upper one: expected lower <= upper");
  }
}

// Refuses reflex thresholds above `most`: the arm would press harder on a person before it stops.
inline void refuse_looser(const SetCollisionThresholds& asked, const SetCollisionThresholds& most) {
  const auto compare = [](const auto& found, const auto& limit, const char* what, const char* where) {
    for (Eigen::Index i = 0; i < found.size(); ++i) {
      if (found[i] <= limit[i] * (1 + 1e-9)) continue;
      throw std::invalid_argument(
          fmt::format("{} {}{}: {:.4g} exceeds {:.4g}, the scene's threshold for a stop of the arm; request "
                      "less, or raise 'collision' of the arm in the scene",
                      what, where, i + 1, found[i], limit[i]));
    }
  };
  const auto both = [&](const ContactThresholds& found, const ContactThresholds& limit, const char* torque,
                        const char* force) {
    compare(found.torque_upper, limit.torque_upper, torque, "of joint ");
    compare(found.wrench_upper, limit.wrench_upper, force, "of axis ");
  };
  const ContactThresholds& accelerating = most.acceleration ? *most.acceleration : most.nominal;
  both(asked.nominal, most.nominal, "upper_torque_thresholds_nominal", "upper_force_thresholds_nominal");
  both(asked.acceleration ? *asked.acceleration : asked.nominal, accelerating,
       "upper_torque_thresholds_acceleration", "upper_force_thresholds_acceleration");
}

// Thresholds that a service may set: ordered, and not above `most`.
inline ArmRequest read_thresholds(const multipanda_msgs::srv::SetCollisionBehavior::Request& request,
                                  std::size_t n, const SetCollisionThresholds& most) {
  const ArmRequest read = read_request(request, n);
  refuse_unordered(std::get<SetCollisionThresholds>(read));
  refuse_looser(std::get<SetCollisionThresholds>(read), most);
  return read;
}

}  // namespace multipanda::ros
