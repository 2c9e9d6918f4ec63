#include "core/features/joint_limits.hpp"

namespace multipanda {
namespace {

enum Parameter : std::size_t { kRange, kStiffness, kDamping };
enum Output : std::size_t { kLargest };

class JointLimits final : public Feature {
 public:
  LawResult start(ControlContext&) override { return LawResult::ok; }

  LawResult update(ControlContext& context) override {
    const auto& parameters = *context.parameters;
    const double r = parameters.number(kRange);
    const double k = parameters.number(kStiffness);
    const double D = parameters.number(kDamping);
    double largest = 0;
    for (auto& arm : context.arms) {
      const auto& limits = arm.model().limits();
      for (Eigen::Index i = 0; i < arm.q().size(); ++i) {
        const double above = r - (arm.q()[i] - limits.q_min[i]);  // > 0: within the lower range
        const double below = r - (limits.q_max[i] - arm.q()[i]);
        double tau = 0;
        if (above > 0) tau += k * above - (arm.dq()[i] < 0 ? D * above / r * arm.dq()[i] : 0);
        if (below > 0) tau -= k * below + (arm.dq()[i] > 0 ? D * below / r * arm.dq()[i] : 0);
        (*arm.tau)[i] += tau;
        largest = std::max(largest, std::abs(tau));
      }
    }
    context.outputs[kLargest] = largest;
    return LawResult::ok;
  }
};

}  // namespace

FeatureType joint_limits_feature() {
  return {
      {.type = "joint_limits",
       .doc = "Pushes every joint back from its position limits, softly from a given range on.",
       .inputs = {},
       .parameters =
           {{"range_rad", "rad", 1, {0.1}, 0.01, 0.5, "Distance from a limit at which the repulsion begins."},
            {"stiffness_nm_per_rad",
             "N m/rad",
             1,
             {40.0},
             0,
             300,
             "Slope of the repulsion inside the range."},
            {"damping_nms_per_rad",
             "N m s/rad",
             1,
             {2.0},
             0,
             20,
             "Damping of outward motion, at the limit."}},
       .outputs = {{"largest_torque_nm", 1, "Largest repulsive torque of this cycle [N m]."}}},
      [](const Surroundings&) -> std::unique_ptr<Feature> { return std::make_unique<JointLimits>(); }};
}

}  // namespace multipanda
