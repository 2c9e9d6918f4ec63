#include "core/controllets/hold.hpp"

#include "core/controllets/damping_design.hpp"

namespace multipanda {
namespace {

enum Parameter : std::size_t { kStiffness, kDampingRatio };

class Hold final : public Controllet {
 public:
  LawResult start(ControlContext& context) override {
    entered_ = false;
    enter(context.arms[0]);
    return LawResult::ok;  // always: there is nothing below it
  }

  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    enter(arm);
    if (!entered_) return LawResult::ok;  // no measurement, no spring: the arm carries itself meanwhile
    const auto K = context.parameters->values(kStiffness);
    JointVector stiffness = arm.q();
    for (Eigen::Index i = 0; i < stiffness.size(); ++i) stiffness[i] = K[static_cast<std::size_t>(i)];
    // Of the coupled inertia, not of its diagonal: with the elbow bent, joints that move against each other
    // have a tenth of it, and damping for the whole makes them swing where the motors lag by a few
    // milliseconds.
    const JointMatrix D = joint_damping(arm.terms->M(), stiffness, context.parameters->number(kDampingRatio));
    *arm.tau = stiffness.cwiseProduct(q_0_ - arm.q()) - D.lazyProduct(arm.dq()) + arm.terms->c();
    return LawResult::ok;
  }

 private:
  // An arm is often handed over because its measurement is bad: the first usable one counts.
  void enter(const OwnedArm& arm) {
    if (entered_ || !arm.q().allFinite()) return;
    const auto& limits = arm.model().limits();
    q_0_ = arm.q().cwiseMax(limits.q_min).cwiseMin(limits.q_max);
    entered_ = true;
  }

  JointVector q_0_;
  bool entered_ = false;
};

}  // namespace

ControlletType hold_controllet() {
  return {{.type = "hold",
           .doc = "Holds one arm where it entered: soft joint spring, damped. The safe default of every arm.",
           .inputs = {},
           .parameters = {{"stiffness_nm_per_rad",
                           "N m/rad",
                           ParameterSpec::kPerJoint,
                           {300, 300, 300, 300, 120, 80, 40, 40, 40, 40, 40, 40, 40, 40, 40, 40},
                           0,
                           1000,
                           "K, per joint."},
                          {"damping_ratio", "", 1, {1.0}, 0.1, 2, "zeta of every coupled mode."}},
           .outputs = {}},
          [](ArmModels) -> std::unique_ptr<Controllet> { return std::make_unique<Hold>(); }};
}

}  // namespace multipanda
