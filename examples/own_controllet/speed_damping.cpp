#include "speed_damping.hpp"

#include <algorithm>

namespace {

using namespace multipanda;

class SpeedDamping final : public Feature {
 public:
  static ControlletDescriptor descriptor() {
    return {.type = "speed_damping",
            .doc = "Damps joints that move faster than a given speed.",
            .parameters = spec_table<kParameterCount>(
                parameter_at<kSpeed>({.name = "speed_rad_per_s",
                                      .unit = "rad/s",
                                      .initial = {1.0},
                                      .max = 10,
                                      .doc = "Joint speed v_0 at which the damping begins."}),
                parameter_at<kDamping>({.name = "damping_nms_per_rad",
                                        .unit = "N m s/rad",
                                        .initial = {5.0},
                                        .max = 20,
                                        .doc = "Damping d above that speed."})),
            .outputs = spec_table<kOutputCount>(
                output_at<kLargest>("largest_torque_nm", "Largest damping torque of this cycle."))};
  }

  LawResult start(ControlContext&) override { return LawResult::ok; }

  // Called after the controllet's update(): arms[i].tau holds its torque. Add to it.
  LawResult update(ControlContext& context) override {
    const double v_0 = context.parameters->number(kSpeed), d = context.parameters->number(kDamping);
    double largest = 0;
    for (OwnedArm& arm : context.arms) {
      for (Eigen::Index i = 0; i < arm.dq().size(); ++i) {
        const double dq = arm.dq()[i];
        const double tau = d * (dq - std::clamp(dq, -v_0, v_0));
        (*arm.tau)[i] -= tau;
        largest = std::max(largest, std::abs(tau));
      }
    }
    context.outputs[kLargest] = largest;
    return LawResult::ok;
  }

 private:
  enum Parameter : std::size_t { kSpeed, kDamping, kParameterCount };
  enum Output : std::size_t { kLargest, kOutputCount };
};

}  // namespace

multipanda::FeatureType speed_damping_feature() { return multipanda::feature_type<SpeedDamping>(); }
