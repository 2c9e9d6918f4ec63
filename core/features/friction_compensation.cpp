#include "core/features/friction_compensation.hpp"

#include <cmath>
#include <string>
#include <vector>

namespace multipanda {
namespace {

enum Parameter : std::size_t { kGain, kFade };
enum Output : std::size_t { kLargest, kPower };

class FrictionCompensation final : public Feature {
 public:
  explicit FrictionCompensation(const Surroundings& surroundings) {
    for (const ArmIndex arm : surroundings.own) {
      const ArmModel& model = *surroundings.arms[arm];
      if (surroundings.friction_compensated.contains(arm)) {
        refusal_ =
            "arm '" + model.name() +
            "' meets no joint friction in this backend, or compensates it itself: leave the feature out";
      } else if (!model.known_friction()) {
        refusal_ = "nothing is known of the joint friction of arm '" + model.name() +
                   "': give its scene entry 'known_friction: model', or leave the feature out";
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
  static double sigmoid(double x) { return 1 / (1 + std::exp(-x)); }

  struct Table {
    JointFrictionTable friction;
    JointVector at_rest;  // p1 / (1 + exp(-p2 p3)) [N m]
  };
  std::vector<Table> tables_;  // one per arm
  std::string refusal_;
};

}  // namespace

FeatureType friction_compensation_feature() {
  return {
      {.type = "friction_compensation",
       .doc = "Adds the joints' friction as far as it is known of the arm, in the direction of motion.",
       .inputs = {},
       .parameters = {{"gain", "", 1, {0.8}, 0, 1, "k: share of the known friction that is compensated."},
                      {"fade_rad_per_s",
                       "rad/s",
                       1,
                       {0.01},
                       0,
                       0.5,
                       "v_0: at this velocity of a joint half of its compensation acts, at rest nothing."}},
       .outputs = {{"largest_torque_nm", 1, "Largest torque of a joint in this cycle [N m]."},
                   {"power_w", 1, "What the compensation puts into the arms [W]."}}},
      [](const Surroundings& surroundings) -> std::unique_ptr<Feature> {
        return std::make_unique<FrictionCompensation>(surroundings);
      }};
}

}  // namespace multipanda
