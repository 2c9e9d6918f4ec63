#include "python_bindings/state_row.hpp"

#include <algorithm>

#include "scene/build.hpp"

namespace multipanda {

StateRow::StateRow(const Scene& scene) {
  for (const auto& arm : scene.arms) {
    const auto joints = static_cast<std::size_t>(arm.q_start.size());
    FieldList list(8 * size_);
    visit_sample(list, ArmSample{}, joints);
    list.add("X_WE", 'f', kPose);
    list.add("gripper", 'f', 3);
    list.add("held", 'f', 1);
    arms_.push_back({.name = arm.name, .joints = joints, .first = size_, .fields = std::move(list.fields())});
    size_ = list.offset() / 8;
  }
  for (const auto& object : scene.objects) {
    if (object.fixed) continue;
    objects_.push_back({.name = object.name, .first = size_});
    size_ += kPose;
  }
}

void StateRow::write_arm(std::size_t arm, const ArmSample& sample, const Pose& X_WE, bool held,
                         double* row) const {
  NumberWriter to(row + arms_[arm].first);
  visit_sample(to, sample, arms_[arm].joints);
  to.many("X_WE", std::span<const double>(X_WE.values()), true);
  const std::array<double, 3> gripper{sample.gripper_width, sample.gripper_grasped ? 1.0 : 0.0,
                                      sample.gripper_moving ? 1.0 : 0.0};
  to.many("gripper", std::span<const double>(gripper), true);
  to.one("held", held, true);
}

void StateRow::write_object(std::size_t object, const Pose& X_WO, double* row) const {
  std::ranges::copy(X_WO.values(), row + objects_[object].first);
}

}  // namespace multipanda
