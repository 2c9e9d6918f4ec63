#include "runtime/target_values.hpp"

#include <algorithm>

namespace multipanda {

void to_world(Quantity quantity, const Pose& X_WB, std::span<double> v) {
  if (quantity == Quantity::pose) {
    // Rotated without normalization: the check for unit length comes later.
    const Quaternion q = X_WB.quaternion() * Quaternion(v[3], v[4], v[5], v[6]);
    const Vector3 p = X_WB * Vector3(v[0], v[1], v[2]);
    const double world[7] = {p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z()};
    std::copy_n(world, 7, v.begin());
    return;
  }
  for (const std::size_t at : {std::size_t{0}, std::size_t{3}}) {
    const Vector3 turned = X_WB.rotation * Vector3(v[at], v[at + 1], v[at + 2]);
    for (std::size_t i = 0; i < 3; ++i) v[at + i] = turned[static_cast<Eigen::Index>(i)];
  }
}

std::optional<std::size_t> joint_beyond_limit(const ArmModel& model, std::span<const double> q) {
  const ArmLimits& limits = model.limits();
  for (std::size_t i = 0; i < q.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    if (q[i] < limits.q_min[k] || q[i] > limits.q_max[k]) return i;
  }
  return {};
}

}  // namespace multipanda
