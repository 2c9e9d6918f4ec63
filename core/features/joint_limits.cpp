#include "core/features/joint_limits.hpp"

#include <algorithm>

#include "core/controllets/bearable_damping.hpp"

namespace multipanda {
namespace {

class JointLimits final : public Feature {
 public:
  explicit JointLimits(const FeatureContext& context) {
    for (const ArmIndex arm : context.own) bearable_.push_back(bearable_damping(*context.arms[arm]));
  }

  static ControlletDescriptor descriptor() {
    return {.type = "joint_limits",
            .doc = "Pushes every joint softly back from its position limits, within a given range of them.",
            .parameters = spec_table<kParameterCount>(
                parameter_at<kRange>({.name = "range_rad",
                                      .unit = "rad",
                                      .initial = {0.1},
                                      .min = 0.01,
                                      .max = 0.5,
                                      .doc = "Distance from a limit at which the repulsion begins."}),
                parameter_at<kStiffness>({.name = "stiffness_nm_per_rad",
                                          .unit = "N m/rad",
                                          .initial = {40.0},
                                          .max = 300,
                                          .doc = "Slope of the repulsion within the range."}),
                parameter_at<kDamping>(
                    {.name = "damping_nms_per_rad",
                     .unit = "N m s/rad",
                     .initial = {2.0},
                     .max = 20,
                     .doc = "Damping of outward motion at the limit; of a joint with little inertia, "
                            "what it bears at 1 kHz."})),
            .outputs = spec_table<kOutputCount>(
                output_at<kLargest>("largest_torque_nm", "Largest repulsive torque of this cycle [N m]."))};
  }

  LawResult start(ControlContext&) override { return LawResult::ok; }

  LawResult update(ControlContext& context) override {
    const auto& parameters = *context.parameters;
    const double r = parameters.number(kRange);
    const double k = parameters.number(kStiffness);
    const double damping = parameters.number(kDamping);
    double largest = 0;
    for (std::size_t a = 0; a < context.arms.size(); ++a) {
      OwnedArm& arm = context.arms[a];
      const auto& limits = arm.model().limits();
      for (Eigen::Index i = 0; i < arm.q().size(); ++i) {
        const double above = r - (arm.q()[i] - limits.q_min[i]);  // > 0: within the lower range
        const double below = r - (limits.q_max[i] - arm.q()[i]);
        const double D = std::min(damping, bearable_[a][i]);
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

 private:
  enum Parameter : std::size_t { kRange, kStiffness, kDamping, kParameterCount };
  enum Output : std::size_t { kLargest, kOutputCount };

  std::vector<JointVector> bearable_;  // of each arm
};

}  // namespace

FeatureType joint_limits_feature() { return feature_type<JointLimits>(); }

}  // namespace multipanda
