#include "virtual_wall.hpp"

#include <algorithm>

namespace {

using multipanda::ControlContext;
using multipanda::LawResult;
using multipanda::Vector3;

// In the order of the lists in virtual_wall_controllet().
enum Parameter : std::size_t { kNormal, kHeight, kStiffness, kDamping };
enum Output : std::size_t { kDepth };

class VirtualWall final : public multipanda::Controllet {
 public:
  LawResult start(ControlContext& context) override {
    // Entering behind the wall would kick the arm: refuse, and say so by the verdict start_refused.
    return depth(context) > 0.01 ? LawResult::fault : LawResult::ok;
  }

  // Called every millisecond: no allocation, no lock, no log, no exception.
  LawResult update(ControlContext& context) override {
    multipanda::OwnedArm& arm = context.arms[0];
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
  static Vector3 normal(const ControlContext& context) {
    const Vector3 n = context.parameters->vector3(kNormal);
    return n.norm() > 1e-3 ? Vector3(n.normalized()) : Vector3(Vector3::UnitZ());
  }
  static double depth(const ControlContext& context) {
    return context.parameters->number(kHeight) - normal(context).dot(context.arms[0].terms->X_WE().position);
  }
};

}  // namespace

multipanda::ControlletType virtual_wall_controllet() {
  return {{.type = "virtual_wall",
           .doc = "Hand guiding that stops at a plane.",
           .inputs = {},
           .parameters = {{"normal", "", 3, {0, 0, 1}, -1, 1, "n: normal of the wall, world; any length."},
                          {"height_m", "m", 1, {0.2}, -3, 3, "h: distance of the wall from the origin."},
                          {"stiffness_n_per_m", "N/m", 1, {1000.0}, 0, 3000, "k."},
                          {"damping_ns_per_m", "N s/m", 1, {30.0}, 0, 100, "b, inwards only."}},
           .outputs = {{"depth_m", 1, "How deep the end effector is in the wall."}}},
          [](multipanda::ArmModels) -> std::unique_ptr<multipanda::Controllet> {
            return std::make_unique<VirtualWall>();
          }};
}
