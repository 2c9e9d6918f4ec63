#include "core/controllets/offset_reference.hpp"

namespace multipanda {

OffsetReference::OffsetReference() : reference_({.name = "offset", .quantity = Quantity::pose}, 0) {}

void OffsetReference::start(const Vector3& offset) {
  goal_ = offset;
  reference_.start(Pose{Matrix3::Identity(), offset});
}

void OffsetReference::advance(const Vector3& goal, double max_speed, double dt) {
  reference_.limit_speed(kShare * max_speed);
  if (goal != goal_) reference_.set(pose_target(Pose{Matrix3::Identity(), goal}));
  goal_ = goal;
  reference_.advance(dt, 0);
}

double OffsetReference::top_speed(double max_speed) const {
  return (position() - goal_).norm() < 1e-9 && reference_.twist().vector.isZero(0) ? 0 : kShare * max_speed;
}

}  // namespace multipanda
