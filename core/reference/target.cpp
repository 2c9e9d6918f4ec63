#include "core/reference/target.hpp"

#include <algorithm>

namespace multipanda {

std::string_view to_string(Quantity quantity) {
  switch (quantity) {
    case Quantity::pose:
      return "pose";
    case Quantity::twist:
      return "twist";
    case Quantity::wrench:
      return "wrench";
    case Quantity::joints:
      return "joints";
    case Quantity::scalar:
      return "scalar";
  }
  return "unknown";
}

const std::vector<QuantityKeys>& quantity_keys() {
  static const std::vector<QuantityKeys> table{
      {Quantity::pose,
       {"position_m", "rpy_rad", "quaternion_wxyz"},
       "position_m [m] with rpy_rad [rad] or quaternion_wxyz"},
      {Quantity::twist,
       {"linear_m_per_s", "angular_rad_per_s"},
       "linear_m_per_s [m/s] and/or angular_rad_per_s [rad/s]"},
      {Quantity::wrench, {"force_n", "torque_nm"}, "force_n [N] and/or torque_nm [N m]"},
      {Quantity::joints, {"q_rad"}, "q_rad [rad], one number per joint"},
      {Quantity::scalar, {"value"}, "value, one number"}};
  return table;
}

const QuantityKeys& keys_of(Quantity quantity) { return quantity_keys()[static_cast<std::size_t>(quantity)]; }

std::size_t value_count(Quantity quantity, std::size_t joint_count) {
  switch (quantity) {
    case Quantity::pose:
      return 7;
    case Quantity::twist:
    case Quantity::wrench:
      return 6;
    case Quantity::joints:
      return joint_count;
    case Quantity::scalar:
      return 1;
  }
  return 0;
}

std::size_t motion_count(Quantity quantity, std::size_t joint_count) {
  return quantity == Quantity::pose ? 3 : value_count(quantity, joint_count);
}

void Target::set(std::span<const double> numbers) {
  size = static_cast<std::uint8_t>(std::min<std::size_t>(numbers.size(), UINT8_MAX));
  std::copy_n(numbers.begin(), std::min(numbers.size(), values.size()), values.begin());
}

void Target::to_world(Quantity quantity, const Pose& X_WB) {
  auto& v = values;
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

Target Chunk::sample(std::size_t k) const {
  Target target;
  target.id = id + k;
  target.delivery = Delivery::stream;
  target.size = size;
  target.values = values[k];
  return target;
}

Target pose_target(const Pose& X, double duration_s, Delivery delivery) {
  Target target;
  target.delivery = delivery;
  target.size = 7;
  target.duration_s = duration_s;
  std::ranges::copy(X.values(), target.values.begin());
  return target;
}

}  // namespace multipanda
