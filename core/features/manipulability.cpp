#include "core/features/manipulability.hpp"

#include <algorithm>
#include <limits>

namespace multipanda {
namespace {

enum Parameter : std::size_t { kGain, kThreshold, kDamping };
enum Output : std::size_t { kSmallest, kPotential, kLargest };

constexpr double kFade = 0.1;  // share of m_0 beyond it over which the damping fades

class ManipulabilityFeature final : public Feature {
 public:
  LawResult start(ControlContext&) override { return LawResult::ok; }

  LawResult update(ControlContext& context) override {
    const auto& parameters = *context.parameters;
    const double k_m = parameters.number(kGain), m_0 = parameters.number(kThreshold);
    const double d = parameters.number(kDamping);
    double smallest = std::numeric_limits<double>::infinity(), potential = 0, largest = 0;
    for (auto& arm : context.arms) {
      const Manipulability& m = arm.terms->manipulability_terms();
      smallest = std::min(smallest, m.value);
      const double missing = std::max(0.0, m_0 - m.value);
      const double fade = std::clamp((m_0 - m.value) / (kFade * m_0) + 1, 0.0, 1.0);
      if (fade == 0) continue;
      potential += k_m * missing * missing;
      JointVector tau = 2 * k_m * missing * m.gradient;
      if (d > 0) tau -= d * fade * m.self_motion(arm.terms->J_V_WE(), arm.dq());
      *arm.tau += tau;
      largest = std::max(largest, tau.lpNorm<Eigen::Infinity>());
    }
    context.outputs[kSmallest] = smallest;
    context.outputs[kPotential] = potential;
    context.outputs[kLargest] = largest;
    return LawResult::ok;
  }
};

}  // namespace

FeatureType manipulability_feature() {
  return {{.type = "manipulability",
           .doc = "Pushes arms away from singular poses, softly from a given manipulability down.",
           .inputs = {},
           .parameters = {{"gain_nm", "N m", 1, {10}, 0, 200, "k_m: of the potential k_m (m - m_0)^2."},
                          {"threshold", "", 1, {0.1}, 0.001, 1, "m_0: the push begins below it."},
                          {"damping_nms_per_rad",
                           "N m s/rad",
                           1,
                           {0.05},
                           0,
                           2,
                           "d: of self-motions, where the push acts; 0: the potential alone."}},
           .outputs = {{"manipulability", 1, "Smallest m of the arms."},
                       {"potential_j", 1, "V, summed over the arms [J]."},
                       {"largest_torque_nm", 1, "Largest torque of a joint in this cycle [N m]."}}},
          [](const Surroundings&) -> std::unique_ptr<Feature> {
            return std::make_unique<ManipulabilityFeature>();
          }};
}

}  // namespace multipanda
