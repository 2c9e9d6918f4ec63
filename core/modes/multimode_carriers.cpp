#include "core/modes/multimode_controller.hpp"
#include "core/modes/request.hpp"

// Arms that stand on others: what their laws require of their carrier, and forbid it.
namespace multipanda {

// A Cartesian law bounds speed and force of its own hand only. It may move a carried arm only if that arm has
// a Cartesian law, too, which keeps its hand in the world. An arm that a person guides may only be moved by a
// carrier that a person guides as well.
bool MultimodeController::sweeps_carried_arm(InstanceIndex instance, InstanceSet active) const {
  bool sweeps = false;
  const ControlletDescriptor& law = instances_[instance]->descriptor();
  const bool leads = instance >= arm_count() && !law.guided;
  for (ArmIndex arm = 0; arm < blocks_.mounts.size(); ++arm) {
    if (!blocks_.mounts[arm] || !instances_[instance]->arms().contains(blocks_.mounts[arm]->carrier))
      continue;
    sweeps = sweeps || (leads && blocks_.states[arm].mode == ArmMode::guiding);
    for_each(active, [&](InstanceIndex i) {
      if (!instances_[i]->arms().contains(arm)) return;
      const ControlletDescriptor& carried = instances_[i]->descriptor();
      sweeps = sweeps || (law.wrench_at_hand && !carried.wrench_at_hand) || (leads && carried.guided);
    });
  }
  return sweeps;
}

// A stop of an arm also stops its carrier.
ArmSet MultimodeController::with_carriers(ArmSet arms) const {
  ArmSet all = arms;
  for (ArmIndex arm = 0; arm < blocks_.mounts.size(); ++arm) {
    if (blocks_.mounts[arm] && arms.contains(arm)) all |= ArmSet::of(blocks_.mounts[arm]->carrier);
  }
  return all;
}

// A hand that presses on the world with F presses on its base with -F, which turns the joints of a carrier
// until something else holds them, and then a law of both arms is not passive. Its carrier adds J_c^T F, with
// J_c of the hand by the joints up to the base: what a law of the whole chain from the world to that hand
// would command. F is that of the torques that the motors can give, features included.
void MultimodeController::bear_carried_hands(const Tick& tick) {
  for (ArmIndex arm = 0; arm < blocks_.mounts.size(); ++arm) {
    if (!blocks_.mounts[arm]) continue;
    const auto& [carrier, joint, X_JB] = *blocks_.mounts[arm];
    const InstanceIndex owner = owners_[arm].load(std::memory_order_relaxed);
    if ((ticking_ & bit(owners_[carrier].load(std::memory_order_relaxed))) == 0) continue;
    if (!instances_[owner]->descriptor().wrench_at_hand) continue;
    ModelTerms& terms = blocks_.terms[arm];
    const JointVector& most = safety_.limits(arm).joints.tau_max;
    const JointVector pressing =
        (blocks_.tau_controllet[arm] + blocks_.tau_feature[arm]).cwiseMax(-most).cwiseMin(most);
    const Vector6 F = terms.task().J_bar.transpose().lazyProduct(pressing);
    const JointVector whole =
        blocks_.tau_controllet[carrier] + blocks_.terms[carrier].torque_of(joint, terms.X_WE().position, F);
    if (const Finding finding = safety_.judge(carrier, whole, blocks_.tau_feature[carrier])) {
      evict(owner, arm, finding, tick, true);
    } else {
      blocks_.tau_controllet[carrier] = whole;
    }
  }
}

}  // namespace multipanda
