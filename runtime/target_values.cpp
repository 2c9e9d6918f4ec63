#include "runtime/target_values.hpp"

#include <algorithm>
#include <stdexcept>

#include <fmt/format.h>

#include "core/model/model_terms.hpp"

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

std::string beyond_reach(const std::shared_ptr<const ArmModel>& model, const Pose& X_FE,
                         const Vector3& p_WE) {
  ModelTerms terms(model);
  terms.set_config({.X_FE = X_FE, .X_EK = {}}, {}, {});
  terms.update(model->q_home(), JointVector::Zero(model->q_home().size()));
  const std::size_t n = model->joint_count();
  double reach = (terms.X_WE().position - terms.X_WJ(n - 1).position).norm();
  for (std::size_t i = 1; i < n; ++i) reach += (terms.X_WJ(i).position - terms.X_WJ(i - 1).position).norm();
  const double distance = (p_WE - terms.X_WJ(0).position).norm();
  if (distance <= reach) return {};
  return fmt::format(
      "out of reach: {:.3f} m from the first joint of arm '{}', whose end effector reaches {:.3f} m "
      "at most",
      distance, model->name(), reach);
}

bool is_end_effector_pose(const Instance& instance, const InputSpec& input) {
  return input.quantity == Quantity::pose && input.frame == "world" && instance.arm_list().size() == 1;
}

void check_reach(const std::vector<ScheduledRequest>& timeline, const MultimodeController& modes,
                 const std::vector<std::shared_ptr<const ArmModel>>& models, const std::vector<Pose>& X_FE) {
  for (const ScheduledRequest& event : timeline) {
    if (event.what != ScheduledRequest::What::request || event.request.kind != Request::Kind::set_target)
      continue;
    const Instance& instance = modes.instance(event.request.instance);
    const InputSpec& input = instance.inputs()[event.request.index].spec();
    if (!is_end_effector_pose(instance, input) || event.request.target.delivery == Delivery::motion) continue;
    const ArmIndex arm = instance.arm_list()[input.arm];
    const auto& v = event.request.target.values;
    const std::string why = beyond_reach(models[arm], X_FE[arm], {v[0], v[1], v[2]});
    if (why.empty()) continue;
    throw std::invalid_argument(fmt::format("timeline at {:g} s, '{}', input '{}': {}", event.at.seconds(),
                                            instance.name(), input.name, why));
  }
}

}  // namespace multipanda
