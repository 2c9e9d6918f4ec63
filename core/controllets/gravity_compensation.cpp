#include <algorithm>
#include <vector>

#include "core/controllets/builtins.hpp"
#include "core/controllets/damping_design.hpp"
#include "core/model/prismatic_joints.hpp"

namespace multipanda {
namespace {

// Hand guiding: the arm compensates its own gravity only.
//   tau = C dq - D dq
// Closed loop (exact model): M ddq + D dq = tau_ext. The arm itself compensates gravity (CONVENTIONS.md). D
// [N m s/rad] is a small damping, so that a pushed arm comes to rest.
class GravityCompensation final : public Controllet {
 public:
  explicit GravityCompensation(ArmModels arms) {
    const ArmModel& model = *arms[0];
    if (!has_prismatic_joints(model)) return;
    const JointVector most = bearable_damping(model);
    for (std::size_t i = 0; i < model.joint_count(); ++i) {
      if (!model.is_prismatic(i)) continue;
      const auto k = static_cast<Eigen::Index>(i);
      const double stops = std::min(kStops * model.least_inertia()[k], kEasilyLed);
      carriages_.push_back({k, std::min(stops, most[k]), most[k]});
    }
  }

  static ControlletDescriptor descriptor() {
    return {.type = "gravity_compensation",
            .doc = "Hand guiding: compensates gravity, so that the arm can be moved by hand.",
            .moving_base = true,
            .guided = true,
            .parameters = spec_table<kParameterCount>(parameter_at<kDamping>(
                {.name = "damping_nms_per_rad",
                 .unit = "N m s/rad",
                 .initial = {0.1},
                 .max = 0.25,
                 .doc = "Joint damping D; bounded so that the lightest joint stays stable at 1 kHz. A "
                        "prismatic joint has 100 times as many N s/m, as at a lever of 0.1 m, and at least 2 "
                        "1/s times the least mass that it moves, up to 240 N s/m: its carriage does not "
                        "coast on."}))};
  }

  LawResult start(ControlContext&) override { return LawResult::ok; }

  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    const double D = context.parameters->number(kDamping);
    *arm.tau = arm.terms->c() - D * arm.dq();
    for (const Carriage& carriage : carriages_) {
      const double own = std::clamp(kAtLever * D, carriage.least, carriage.most);
      (*arm.tau)[carriage.joint] -= (own - D) * arm.dq()[carriage.joint];
    }
    if (arm.carried != nullptr) brake_torso(arm);
    return LawResult::ok;
  }

 private:
  enum Parameter : std::size_t { kDamping, kParameterCount };
  // Joints that also move another arm must not coast: they would sweep that arm along.
  static void brake_torso(OwnedArm& arm) {
    for (std::size_t joint = 0; joint <= arm.carried_joint; ++joint) {
      const auto i = static_cast<Eigen::Index>(joint);
      if (!arm.model().is_prismatic(joint)) (*arm.tau)[i] -= kStops * arm.terms->M()(i, i) * arm.dq()[i];
    }
  }
  struct Carriage {
    Eigen::Index joint;
    double least, most;  // damping [N s/m], limited for stability at 1 kHz
  };
  static constexpr double kAtLever = 100;  // N s/m for each N m s/rad, 1 / (0.1 m)^2
  // A carriage released at the speed v comes to rest within v / kStops.
  static constexpr double kStops = 2;  // [1/s]
  // Beyond this, guiding it at the usual speed of hands would require more than the usual force.
  static constexpr double kEasilyLed = ContactBounds{}.spring_force / ContactBounds{}.hand_speed;  // [N s/m]

  std::vector<Carriage> carriages_;
};

}  // namespace

ControlletType gravity_compensation_controllet() { return controllet_type<GravityCompensation>(); }

}  // namespace multipanda
