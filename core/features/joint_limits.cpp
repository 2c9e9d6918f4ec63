#include <algorithm>
#include <limits>

#include "core/controllets/damping_design.hpp"
#include "core/features/bounded_drive.hpp"
#include "core/features/builtins.hpp"

namespace multipanda {
namespace {

// Repulsion from the joint limits. With d the distance of joint i to the nearer limit and r the range:
//   V_i = 1/2 k (r - d)^2 for d < r, otherwise 0;   tau_i = -dV_i/dq_i - D (r - d)/r dq_i while moving
//   outwards.
// The spring is continuous at the edge of the range, and the damping grows from zero there.
class JointLimits final : public Feature {
 public:
  explicit JointLimits(const FeatureContext& context) : drive_(context.own.size()) {
    for (const ArmIndex arm : context.own) bearable_.push_back(bearable_damping(*context.arms[arm]));
  }

  static ControlletDescriptor descriptor() {
    return {.type = "joint_limits",
            .doc = "Pushes every joint softly back from its position limits, within a given range of them.",
            .moving_base = true,
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
                parameter_at<kDamping>({.name = "damping_nms_per_rad",
                                        .unit = "N m s/rad",
                                        .initial = {2.0},
                                        .max = 20,
                                        .doc = "Damping of outward motion at the limit; less for a joint "
                                               "with little inertia, so that it stays stable at 1 kHz."}),
                parameter_at<kLinearRange>({.name = "range_m",
                                            .unit = "m",
                                            .initial = {0.05},
                                            .min = 0.005,
                                            .max = 0.3,
                                            .doc = "The same distance of prismatic joints."}),
                parameter_at<kLinearStiffness>({.name = "stiffness_n_per_m",
                                                .unit = "N/m",
                                                .initial = {1200.0},
                                                .max = 20000,
                                                .doc = "The same slope of prismatic joints; the repulsion "
                                                       "keeps to the bounds for contact."}),
                parameter_at<kLinearDamping>({.name = "damping_n_s_per_m",
                                              .unit = "N s/m",
                                              .initial = {200.0},
                                              .max = 2000,
                                              .doc = "The same damping of prismatic joints."})),
            .outputs = spec_table<kOutputCount>(output_at<kLargest>(
                "largest_torque_nm",
                "Largest repulsive torque of this cycle [N m], force of prismatic joints [N]."))};
  }

  LawResult start(ControlContext&) override { return LawResult::ok; }

  LawResult update(ControlContext& context) override {
    const auto& parameters = *context.parameters;
    const Gains turning{parameters.number(kRange), parameters.number(kStiffness),
                        parameters.number(kDamping)};
    const Gains sliding{parameters.number(kLinearRange), parameters.number(kLinearStiffness),
                        parameters.number(kLinearDamping), context.contact.spring_force};
    double largest = 0;
    for (std::size_t a = 0; a < context.arms.size(); ++a) {
      OwnedArm& arm = context.arms[a];
      const auto& limits = arm.model().limits();
      JointVector spring = JointVector::Zero(arm.q().size()), damping = spring;
      for (Eigen::Index i = 0; i < arm.q().size(); ++i) {
        const auto& [r, k, largest_damping, most] =
            arm.model().is_prismatic(static_cast<std::size_t>(i)) ? sliding : turning;
        const double above = r - (arm.q()[i] - limits.q_min[i]);  // > 0: within the lower range
        const double below = r - (limits.q_max[i] - arm.q()[i]);
        const double D = std::min(largest_damping, bearable_[a][i]);
        if (above > 0) spring[i] += std::min(k * above, most);
        if (below > 0) spring[i] -= std::min(k * below, most);
        if (above > 0 && arm.dq()[i] < 0) damping[i] += D * above / r * arm.dq()[i];
        if (below > 0 && arm.dq()[i] > 0) damping[i] += D * below / r * arm.dq()[i];
      }
      const JointVector tau = drive_[a].limit(context, arm, spring) - damping;
      *arm.tau += tau;
      largest = std::max(largest, tau.lpNorm<Eigen::Infinity>());
    }
    context.outputs[kLargest] = largest;
    return LawResult::ok;
  }

 private:
  enum Parameter : std::size_t {
    kRange,
    kStiffness,
    kDamping,
    kLinearRange,
    kLinearStiffness,
    kLinearDamping,
    kParameterCount
  };
  enum Output : std::size_t { kLargest, kOutputCount };

  struct Gains {
    double range, stiffness, damping;
    double most = std::numeric_limits<double>::infinity();  // bound on the spring of a carriage [N]
  };

  std::vector<JointVector> bearable_;  // of each arm
  std::vector<BoundedDrive> drive_;
};

}  // namespace

FeatureType joint_limits_feature() { return feature_type<JointLimits>(); }

}  // namespace multipanda
