#include "runtime/reach.hpp"

#include <limits>
#include <stdexcept>

#include <fmt/format.h>

#include "core/model/model_terms.hpp"

namespace multipanda {

Reach::Reach(const std::vector<std::shared_ptr<const ArmModel>>& models) {
  for (const auto& model : models) {
    ModelTerms terms(model);
    terms.update(model->q_home(), JointVector::Zero(model->q_home().size()));
    const std::size_t n = model->joint_count();
    Arm& arm = arms_.emplace_back();
    arm.name = model->name();
    arm.first_joint = terms.X_WJ(0).position;
    arm.last_joint = terms.X_WJ(n - 1).position;
    for (std::size_t i = 1; i < n; ++i)
      arm.between += (terms.X_WJ(i).position - terms.X_WJ(i - 1).position).norm();
    arm.X_WF = terms.X_WE();  // no end effector is configured
    arm.length = std::numeric_limits<double>::infinity();
  }
}

void Reach::set_end_effector(ArmIndex index, const Pose& X_FE) {
  Arm& arm = arms_[index];
  arm.length.store(arm.between + (arm.X_WF * X_FE.position - arm.last_joint).norm(),
                   std::memory_order_relaxed);
}

void Reach::take(const Event& event) {
  if (event.kind != EventKind::arm_config || event.arm >= arms_.size()) return;
  const auto& v = event.values;
  set_end_effector(event.arm, Pose::from({v[0], v[1], v[2]}, Quaternion(v[3], v[4], v[5], v[6])));
}

std::string Reach::refusal(const Instance& instance, const InputSpec& input,
                           std::span<const double> values) const {
  if (input.quantity != Quantity::pose || input.frame != "world") return {};
  const Vector3 p_W(values[0], values[1], values[2]);
  const auto& indices = instance.arm_list();
  const Arm& own = arms_[indices[input.arm]];
  const double length = own.length.load(std::memory_order_relaxed), distance = (p_W - own.first_joint).norm();
  if (distance <= length) return {};
  if (indices.size() == 1) {
    return fmt::format(
        "out of reach: {:.3f} m from the first joint of arm '{}', whose end effector reaches {:.3f} m at "
        "most",
        distance, own.name, length);
  }
  // Each hand is within its arm's length of its arm's first joint, so the middle of the hands is within the
  // mean of the lengths of the middle of the joints.
  Vector3 middle = Vector3::Zero();
  double lengths = 0;
  for (const ArmIndex i : indices) {
    middle += arms_[i].first_joint;
    lengths += arms_[i].length.load(std::memory_order_relaxed);
  }
  const auto count = static_cast<double>(indices.size());
  const double from_middle = (p_W - middle / count).norm();
  if (from_middle <= lengths / count) return {};
  return fmt::format(
      "out of reach: {:.3f} m from the first joint of arm '{}', whose end effector reaches {:.3f} m at most, "
      "and "
      "{:.3f} m from the middle of the arms' first joints, where the middle of the hands reaches {:.3f} m at "
      "most",
      distance, own.name, length, from_middle, lengths / count);
}

void Reach::check(const std::vector<ScheduledRequest>& timeline, const MultimodeController& modes) const {
  for (const ScheduledRequest& event : timeline) {
    if (event.what != ScheduledRequest::What::request || event.request.kind != Request::Kind::set_target)
      continue;
    if (event.request.target.delivery == Delivery::motion) continue;
    const Instance& instance = modes.instance(event.request.instance);
    const InputSpec& input = instance.inputs()[event.request.index].spec();
    const std::string why = refusal(instance, input, event.request.target.values);
    if (why.empty()) continue;
    throw std::invalid_argument(fmt::format("timeline at {:g} s, '{}', input '{}': {}", event.at.seconds(),
                                            instance.name(), input.name, why));
  }
}

}  // namespace multipanda
