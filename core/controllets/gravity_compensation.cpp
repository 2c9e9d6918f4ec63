#include "core/controllets/gravity_compensation.hpp"

namespace multipanda {
namespace {

enum Parameter : std::size_t { kDamping };

class GravityCompensation final : public Controllet {
 public:
  LawResult start(ControlContext&) override { return LawResult::ok; }

  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    *arm.tau = arm.terms->c() - context.parameters->number(kDamping) * arm.dq();
    return LawResult::ok;
  }
};

}  // namespace

ControlletType gravity_compensation_controllet() {
  return {{.type = "gravity_compensation",
           .doc = "Hand guiding: the arm weighs nothing and can be moved by hand.",
           .inputs = {},
           .parameters = {{"damping_nms_per_rad",
                           "N m s/rad",
                           1,
                           {0.1},
                           0,
                           0.25,
                           "D of every joint; bounded so that the lightest joint stays stable at 1 kHz."}},
           .outputs = {}},
          [](ArmModels) -> std::unique_ptr<Controllet> { return std::make_unique<GravityCompensation>(); }};
}

}  // namespace multipanda
