#include "core/reference/target.hpp"

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

Target Chunk::sample(std::size_t k) const {
  Target target;
  target.id = id + k;
  target.delivery = Delivery::stream;
  target.size = size;
  target.values = values[k];
  return target;
}

Target pose_target(const Pose& X, double duration_s, Delivery delivery) {
  const Quaternion q = X.quaternion();
  Target target;
  target.delivery = delivery;
  target.size = 7;
  target.duration_s = duration_s;
  target.values = {X.position.x(), X.position.y(), X.position.z(), q.w(), q.x(), q.y(), q.z()};
  return target;
}

}  // namespace multipanda
