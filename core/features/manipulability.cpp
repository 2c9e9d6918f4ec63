#include <algorithm>
#include <limits>

#include "core/features/bounded_drive.hpp"
#include "core/features/builtins.hpp"

namespace multipanda {
namespace {

// Keeps arms away from singular poses. With m = sqrt(det(J J^T)) (core/model/task_space.hpp):
//   V = k_m (m - m_0)^2 for m <= m_0, otherwise 0;   tau = -dV/dq - d w(m) P dq,
// with P the projector onto self-motions and w = 1 up to m_0, fading to 0 at 1.1 m_0. The damping is an
// addition to the paper's law (d = 0): without it, an elbow without other damping oscillates about the
// maximum of m. The torque is bounded, because |dm/dq| is.
class ManipulabilityFeature final : public Feature {
 public:
  static ControlletDescriptor descriptor() {
    return {
        .type = "manipulability",
        .doc = "Pushes arms softly away from singular poses, below a given manipulability.",
        .moving_base = true,
        .parameters = spec_table<kParameterCount>(
            parameter_at<kGain>({.name = "gain_nm",
                                 .unit = "N m",
                                 .initial = {10},
                                 .max = 200,
                                 .doc = "Gain k_m of the potential k_m (m - m_0)^2."}),
            parameter_at<kThreshold>({.name = "threshold",
                                      .initial = {0.1},
                                      .min = 0.001,
                                      .max = 1,
                                      .doc = "m_0: manipulability below which the arm is pushed."}),
            parameter_at<kDamping>({.name = "damping_nms_per_rad",
                                    .unit = "N m s/rad",
                                    .initial = {0.05},
                                    .max = 2,
                                    .doc = "Damping d of self-motions while the potential acts; 0: none."})),
        .outputs = spec_table<kOutputCount>(
            output_at<kSmallest>("manipulability", "Smallest m of the arms."),
            output_at<kPotential>("potential_j", "Potential V, summed over the arms [J]."),
            output_at<kLargest>("largest_torque_nm", "Largest joint torque of this cycle [N m].")),
        .presets = {{"paper",
                     "The paper's potential alone.",
                     {{"gain_nm", {10}}, {"threshold", {0.1}}, {"damping_nms_per_rad", {0}}}}}};
  }

  explicit ManipulabilityFeature(const FeatureContext& context) : drive_(context.own.size()) {}

  LawResult start(ControlContext&) override { return LawResult::ok; }

  LawResult update(ControlContext& context) override {
    const auto& parameters = *context.parameters;
    const double k_m = parameters.number(kGain), m_0 = parameters.number(kThreshold);
    const double d = parameters.number(kDamping);
    double smallest = std::numeric_limits<double>::infinity(), potential = 0, largest = 0;
    for (std::size_t a = 0; a < context.arms.size(); ++a) {
      OwnedArm& arm = context.arms[a];
      const Manipulability& m = arm.terms->manipulability_terms();
      smallest = std::min(smallest, m.value);
      const double missing = std::max(0.0, m_0 - m.value);
      const double fade = std::clamp((m_0 - m.value) / (kFade * m_0) + 1, 0.0, 1.0);
      if (fade == 0) continue;
      potential += k_m * missing * missing;
      JointVector tau = drive_[a].limit(context, arm, 2 * k_m * missing * m.gradient);
      if (d > 0) tau -= d * fade * m.self_motion(arm.terms->J_V_WE(), arm.dq());
      *arm.tau += tau;
      largest = std::max(largest, tau.lpNorm<Eigen::Infinity>());
    }
    context.outputs[kSmallest] = smallest;
    context.outputs[kPotential] = potential;
    context.outputs[kLargest] = largest;
    return LawResult::ok;
  }

 private:
  enum Parameter : std::size_t { kGain, kThreshold, kDamping, kParameterCount };
  enum Output : std::size_t { kSmallest, kPotential, kLargest, kOutputCount };
  static constexpr double kFade = 0.1;  // fraction of m_0 above it over which the damping fades

  std::vector<BoundedDrive> drive_;  // of each arm
};

}  // namespace

FeatureType manipulability_feature() { return feature_type<ManipulabilityFeature>(); }

}  // namespace multipanda
