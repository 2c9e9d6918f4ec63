#pragma once

#include <array>
#include <builtin_interfaces/msg/time.hpp>
#include <cstdint>
#include <geometry_msgs/msg/pose.hpp>
#include <geometry_msgs/msg/transform.hpp>
#include <geometry_msgs/msg/wrench.hpp>
#include <multipanda_msgs/msg/robot_model.hpp>
#include <multipanda_msgs/msg/robot_state.hpp>
#include <vector>

#include "core/model/model_terms.hpp"
#include "core/record/cycle_record.hpp"
#include "core/state/arm_state.hpp"
#include "core/types/spatial.hpp"

// Conversions from the core's types to messages.
namespace multipanda::ros {

inline builtin_interfaces::msg::Time to_time(std::int64_t ns) {
  constexpr std::int64_t kSecond = 1000000000;
  builtin_interfaces::msg::Time out;
  out.sec = static_cast<std::int32_t>(ns / kSecond);
  out.nanosec = static_cast<std::uint32_t>(ns % kSecond);
  return out;
}

inline void set_vector(auto& out, const auto& v) { out.x = v[0], out.y = v[1], out.z = v[2]; }

inline void set_rotation(auto& out, const Quaternion& q) {
  out.w = q.w(), out.x = q.x(), out.y = q.y(), out.z = q.z();
}

inline void set_pose(geometry_msgs::msg::Pose& out, const Pose& X) {
  set_vector(out.position, X.position);
  set_rotation(out.orientation, X.quaternion());
}

inline void set_transform(geometry_msgs::msg::Transform& out, const Pose& X) {
  set_vector(out.translation, X.position);
  set_rotation(out.rotation, X.quaternion());
}

inline void set_wrench(geometry_msgs::msg::Wrench& out, const std::array<double, 6>& F) {
  set_vector(out.force, F.data());
  set_vector(out.torque, F.data() + 3);
}

// Row-major. The vector keeps its memory.
template <class Matrix>
void set_matrix(std::vector<double>& out, const Matrix& matrix) {
  out.clear();
  for (Eigen::Index row = 0; row < matrix.rows(); ++row) {
    for (Eigen::Index column = 0; column < matrix.cols(); ++column) out.push_back(matrix(row, column));
  }
}

// Content of messages about one arm. Each function writes into a message that may have been used before, and
// reuses its memory.

// Sets the measured and reported state and the configuration of the arm. Leaves header, names, owner and
// commands unchanged.
void fill_state(const ArmSample& sample, const ArmFrames& frames, const Load& tool, const Load& load,
                ModelTerms& terms, multipanda_msgs::msg::RobotState& out);
void fill_state(const ArmState& state, ModelTerms& terms, multipanda_msgs::msg::RobotState& out);
// Sets everything except header and names.
void fill_model(ModelTerms& terms, multipanda_msgs::msg::RobotModel& out);

}  // namespace multipanda::ros
