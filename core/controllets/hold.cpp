#include "core/controllets/hold.hpp"

#include "core/controllets/damping_design.hpp"

namespace multipanda {
namespace {

class Hold final : public Controllet {
 public:
  static ControlletDescriptor descriptor() {
    return {.type = "hold",
            .doc = "Holds one arm where it is: a soft, damped joint spring. The safe default of every arm.",
            .parameters = spec_table<kParameterCount>(
                parameter_at<kStiffness>(
                    {.name = "stiffness_nm_per_rad",
                     .unit = "N m/rad",
                     .size = ParameterSpec::kPerJoint,
                     .initial = {300, 300, 300, 300, 120, 80, 40, 40, 40, 40, 40, 40, 40, 40, 40, 40},
                     .max = 1000,
                     .doc = "Joint stiffness K."}),
                parameter_at<kDampingRatio>({.name = "damping_ratio",
                                             .initial = {1.0},
                                             .min = 0.1,
                                             .max = 2,
                                             .doc = "Damping ratio zeta of every coupled mode."}))};
  }

  LawResult start(ControlContext& context) override {
    entered_ = false;
    enter(context.arms[0]);
    return LawResult::ok;  // always, because there is no other fallback
  }

  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    enter(arm);
    if (!entered_)
      return LawResult::ok;  // no usable measurement yet: zero torque, the arm compensates its gravity
    const auto K = context.parameters->values(kStiffness);
    JointVector stiffness = arm.q();
    for (Eigen::Index i = 0; i < stiffness.size(); ++i) stiffness[i] = K[static_cast<std::size_t>(i)];
    // Use the coupled inertia and not its diagonal: with a bent elbow, joints that move against each other
    // have a tenth of it, and damping designed for the diagonal makes them oscillate if the motors lag by a
    // few milliseconds.
    const JointMatrix D = joint_damping(arm.terms->M(), stiffness, context.parameters->number(kDampingRatio));
    *arm.tau = stiffness.cwiseProduct(q_0_ - arm.q()) - D.lazyProduct(arm.dq()) + arm.terms->c();
    return LawResult::ok;
  }

 private:
  enum Parameter : std::size_t { kStiffness, kDampingRatio, kParameterCount };

  // A hold often starts because a measurement is invalid. It holds the first valid one.
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

ControlletType hold_controllet() { return controllet_type<Hold>(); }

}  // namespace multipanda
