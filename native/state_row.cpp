#include "native/state_row.hpp"

#include <algorithm>

#include "scene/build.hpp"

namespace multipanda {
namespace {

double* append(double* to, const JointVector& values, std::size_t joints) {
  // A backend that has no such measurement leaves it empty.
  for (std::size_t k = 0; k < joints; ++k)
    *to++ = static_cast<Eigen::Index>(k) < values.size() ? values[static_cast<Eigen::Index>(k)] : 0;
  return to;
}

double* append(double* to, const Pose& X) {
  const Eigen::Quaterniond q(X.rotation);
  const double numbers[] = {X.position.x(), X.position.y(), X.position.z(), q.w(), q.x(), q.y(), q.z()};
  return std::copy(std::begin(numbers), std::end(numbers), to);
}

double* append(double* to, const Wrench& F) {
  for (Eigen::Index k = 0; k < 3; ++k) to[k] = F.force()[k], to[3 + k] = F.torque()[k];
  return to + StateRow::kWrench;
}

}  // namespace

StateRow::StateRow(const Scene& scene) {
  for (const auto& arm : scene.arms) {
    arms_.push_back(
        {.name = arm.name, .joints = static_cast<std::size_t>(arm.q_start.size()), .first = size_});
    size_ += arms_.back().size();
  }
  for (const auto& object : scene.objects) {
    if (object.fixed) continue;
    objects_.push_back({.name = object.name, .first = size_});
    size_ += kPose;
  }
}

void StateRow::write_arm(std::size_t arm, const ArmState& state, ModelTerms& terms, bool held,
                         double* row) const {
  const std::size_t n = arms_[arm].joints;
  double* to = row + arms_[arm].first;
  for (const JointVector* values : {&state.q, &state.dq, &state.tau_J, &state.tau_J_d})
    to = append(to, *values, n);
  terms.update(state);
  to = append(to, terms.X_WE());
  to = append(append(to, state.F_K_W_est), state.F_K_W_true);
  *to++ = state.gripper.width;
  *to++ = state.gripper.grasped ? 1 : 0;
  *to++ = state.gripper.moving ? 1 : 0;
  *to = held ? 1 : 0;
}

void StateRow::write_object(std::size_t object, const Pose& X_WO, double* row) const {
  append(row + objects_[object].first, X_WO);
}

}  // namespace multipanda
