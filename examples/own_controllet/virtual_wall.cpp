#include "virtual_wall.hpp"

#include <algorithm>

namespace {

using namespace multipanda;

class VirtualWall final : public Controllet {
 public:
  static ControlletDescriptor descriptor() {
    return {.type = "virtual_wall",
            .doc = "Hand guiding that stops at a plane.",
            .parameters = spec_table<kParameterCount>(
                parameter_at<kNormal>({.name = "normal",
                                       .size = 3,
                                       .initial = {0, 0, 1},
                                       .min = -1,
                                       .max = 1,
                                       .doc = "Normal n of the wall, world axes; any length."}),
                parameter_at<kHeight>({.name = "height_m",
                                       .unit = "m",
                                       .initial = {0.2},
                                       .min = -3,
                                       .max = 3,
                                       .doc = "Distance h of the wall from the origin."}),
                parameter_at<kStiffness>({.name = "stiffness_n_per_m",
                                          .unit = "N/m",
                                          .initial = {1000.0},
                                          .max = 3000,
                                          .doc = "Stiffness k."}),
                parameter_at<kDamping>({.name = "damping_ns_per_m",
                                        .unit = "N s/m",
                                        .initial = {30.0},
                                        .max = 100,
                                        .doc = "Damping b of inward motion."})),
            .outputs = spec_table<kOutputCount>(
                output_at<kDepth>("depth_m", "Depth of the end effector in the wall."))};
  }

  LawResult start(ControlContext& context) override {
    // Starting deep behind the wall would cause a torque spike. The request gets the verdict start_refused.
    return depth(context) > 0.01 ? LawResult::fault : LawResult::ok;
  }

  // Called every millisecond: no allocation, no lock, no log, no exception.
  LawResult update(ControlContext& context) override {
    OwnedArm& arm = context.arms[0];
    *arm.tau = arm.terms->c();
    const double d = depth(context);
    context.outputs[kDepth] = std::max(d, 0.0);
    if (!(d > 0)) return arm.tau->allFinite() ? LawResult::ok : LawResult::fault;

    const Vector3 n = normal(context);
    const double inwards = std::max(0.0, -n.dot(arm.terms->V_WE().linear()));
    const double force =
        context.parameters->number(kStiffness) * d + context.parameters->number(kDamping) * inwards;
    *arm.tau += arm.terms->J_V_WE().topRows<3>().transpose() * (force * n);
    return arm.tau->allFinite() ? LawResult::ok : LawResult::fault;
  }

 private:
  // Each entry of the descriptor names its enumerator: the compiler checks that the lists agree.
  enum Parameter : std::size_t { kNormal, kHeight, kStiffness, kDamping, kParameterCount };
  enum Output : std::size_t { kDepth, kOutputCount };

  static Vector3 normal(const ControlContext& context) {
    const Vector3 n = context.parameters->vector3(kNormal);
    return n.norm() > 1e-3 ? Vector3(n.normalized()) : Vector3(Vector3::UnitZ());
  }
  static double depth(const ControlContext& context) {
    return context.parameters->number(kHeight) - normal(context).dot(context.arms[0].terms->X_WE().position);
  }
};

}  // namespace

multipanda::ControlletType virtual_wall_controllet() { return multipanda::controllet_type<VirtualWall>(); }
