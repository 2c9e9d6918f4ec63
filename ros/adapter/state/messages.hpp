#pragma once

#include <array>
#include <builtin_interfaces/msg/time.hpp>
#include <cstdint>
#include <geometry_msgs/msg/pose.hpp>
#include <geometry_msgs/msg/transform.hpp>
#include <geometry_msgs/msg/wrench.hpp>
#include <vector>

#include "core/record/cycle_record.hpp"
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

}  // namespace multipanda::ros
