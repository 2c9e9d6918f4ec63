#include "core/controllets/gravity_compensation.hpp"

namespace multipanda {
namespace {

class GravityCompensation final : public Controllet {
 public:
  static ControlletDescriptor descriptor() {
    return {.type = "gravity_compensation",
            .doc = "Hand guiding: compensates gravity, so that the arm can be moved by hand.",
            .parameters = spec_table<kParameterCount>(parameter_at<kDamping>(
                {.name = "damping_nms_per_rad",
                 .unit = "N m s/rad",
                 .initial = {0.1},
                 .max = 0.25,
                 .doc = "Joint damping D; bounded so that the lightest joint stays stable at 1 kHz. A "
                        "prismatic joint has 100 times as many N s/m, as at a lever of 0.1 m."}))};
  }

  LawResult start(ControlContext&) override { return LawResult::ok; }

  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    *arm.tau = arm.terms->c() - context.parameters->number(kDamping) * arm.dq();
    for (std::size_t i = 0; i < arm.model().joint_count(); ++i) {
      if (!arm.model().is_prismatic(i)) continue;
      const auto j = static_cast<Eigen::Index>(i);
      const double more = kAtLever - 1;  // than above
      (*arm.tau)[j] -= more * context.parameters->number(kDamping) * arm.dq()[j];
    }
    return LawResult::ok;
  }

 private:
  enum Parameter : std::size_t { kDamping, kParameterCount };
  static constexpr double kAtLever = 100;  // N s/m for each N m s/rad, 1 / (0.1 m)^2
};

}  // namespace

ControlletType gravity_compensation_controllet() { return controllet_type<GravityCompensation>(); }

}  // namespace multipanda
