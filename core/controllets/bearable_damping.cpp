#include "core/controllets/bearable_damping.hpp"

#include "core/types/time.hpp"

namespace multipanda {

JointVector bearable_damping(const ArmModel& model) {
  return kBearableShare / kArmPeriod * model.least_inertia();
}

void bound_damping(const ArmModel& model, std::size_t i, ParameterSet& parameters) {
  const JointVector most = bearable_damping(model);
  parameters.lower_max(
      i, {most.data(), static_cast<std::size_t>(most.size())},
      model.motor_inertia().size() > 0
          ? "sampled at 1 kHz, more damping makes the inertia of this joint, links and motor, "
            "oscillate"
          : "sampled at 1 kHz, more damping makes the inertia of this joint oscillate; this "
            "arm's model has no motor inertia, which real arms have");
}

}  // namespace multipanda
