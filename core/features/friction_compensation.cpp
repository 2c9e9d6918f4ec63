#include <cmath>
#include <string>
#include <vector>

#include "core/features/builtins.hpp"

namespace multipanda {
namespace {

// Compensates the known joint friction (ArmModel::known_friction):
//   tau = k s(dq) tau_f(dq),   s = dq^2 / (dq^2 + v_0^2),   0 <= k <= 1,
// with tau_f the known table [N m]. Smooth, with zero value and slope at rest: it does not chatter or amplify
// velocity noise about zero. It never exceeds the known friction and is in phase with it, so that both
// together dissipate power unless the table exceeds the true friction. Refuses to start if the friction of an
// arm is unknown, or if its backend leaves none to compensate.
class FrictionCompensation final : public Feature {
 public:
  static ControlletDescriptor descriptor() {
    return {.type = "friction_compensation",
            .doc = "Compensates the known joint friction of each arm, in the direction of motion.",
            .moving_base = true,
            .parameters = spec_table<kParameterCount>(
                parameter_at<kGain>({.name = "gain",
                                     .initial = {0.8},
                                     .max = 1,
                                     .doc = "k: fraction of the known friction that is compensated."}),
                parameter_at<kFade>(
                    {.name = "fade_rad_per_s",
                     .unit = "rad/s",
                     .initial = {0.01},
                     .max = 0.5,
                     .doc = "v_0: joint velocity at which half of the compensation acts; none acts at "
                            "rest."})),
            .outputs = spec_table<kOutputCount>(
                output_at<kLargest>("largest_torque_nm", "Largest joint torque of this cycle [N m]."),
                output_at<kPower>("power_w", "Power of the compensation into the arms [W]."))};
  }

  explicit FrictionCompensation(const FeatureContext& context) {
    for (const ArmIndex arm : context.own) {
      const ArmModel& model = *context.arms[arm];
      if (context.friction_compensated.contains(arm)) {
        refusal_ =
            "arm '" + model.name() +
            "' has no joint friction in this backend, or the backend compensates it: remove the feature";
      } else if (!model.known_friction()) {
        refusal_ = "the joint friction of arm '" + model.name() +
                   "' is unknown: add 'known_friction: model' to its scene entry, or remove the feature";
      } else {
        Table table{*model.known_friction(), model.known_friction()->p1};
        for (Eigen::Index i = 0; i < table.at_rest.size(); ++i) {
          table.at_rest[i] = table.friction.p1[i] * sigmoid(table.friction.p2[i] * table.friction.p3[i]);
        }
        tables_.push_back(std::move(table));
      }
      if (!refusal_.empty()) return;
    }
  }

  std::string_view refusal() const override { return refusal_; }
  LawResult start(ControlContext&) override { return refusal_.empty() ? LawResult::ok : LawResult::fault; }

  LawResult update(ControlContext& context) override {
    const double k = context.parameters->number(kGain), v_0 = context.parameters->number(kFade);
    double largest = 0, power = 0;
    for (std::size_t a = 0; a < context.arms.size(); ++a) {
      const OwnedArm& arm = context.arms[a];
      const Table& table = tables_[a];
      const JointVector& dq = arm.dq();
      for (Eigen::Index i = 0; i < dq.size(); ++i) {
        const double square = dq[i] * dq[i];
        if (square == 0) continue;
        const double p1 = table.friction.p1[i], p2 = table.friction.p2[i], p3 = table.friction.p3[i];
        const double known = p1 * sigmoid(p2 * (dq[i] + p3)) - table.at_rest[i];
        const double tau = k * square / (square + v_0 * v_0) * known;
        (*arm.tau)[i] += tau;
        largest = std::max(largest, std::abs(tau));
        power += tau * dq[i];
      }
    }
    context.outputs[kLargest] = largest;
    context.outputs[kPower] = power;
    return LawResult::ok;
  }

 private:
  enum Parameter : std::size_t { kGain, kFade, kParameterCount };
  enum Output : std::size_t { kLargest, kPower, kOutputCount };

  static double sigmoid(double x) { return 1 / (1 + std::exp(-x)); }

  struct Table {
    JointFrictionTable friction;
    JointVector at_rest;  // p1 / (1 + exp(-p2 p3)) [N m]
  };
  std::vector<Table> tables_;  // one per arm
  std::string refusal_;
};

}  // namespace

FeatureType friction_compensation_feature() { return feature_type<FrictionCompensation>(); }

}  // namespace multipanda
