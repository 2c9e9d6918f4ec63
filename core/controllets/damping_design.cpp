#include "core/controllets/damping_design.hpp"

#include <algorithm>

#include "core/types/time.hpp"

namespace multipanda {

Matrix6 task_damping(const Matrix6& Lambda, const Matrix6& stiffness, double zeta) {
  return coupled_damping(Lambda, stiffness, zeta);
}

JointMatrix coupled_damping(const JointMatrix& inertia, const JointMatrix& stiffness, double zeta) {
  if (inertia.rows() == 7) return coupled_damping<Matrix7>(inertia, stiffness, zeta);
  return coupled_damping<JointMatrix>(inertia, stiffness, zeta);
}

JointVector diagonal_damping(const JointMatrix& M, const JointVector& stiffness, double zeta) {
  return 2.0 * zeta * (stiffness.array() * M.diagonal().array()).sqrt().matrix();
}

JointMatrix mass_with_motors(ModelTerms& terms) {
  JointMatrix M = terms.M();
  const JointVector& motors = terms.model().motor_inertia();
  const JointVector& known = terms.model().known_motor_inertia();
  if (motors.size() != M.rows()) return M;
  M.diagonal() += motors;
  if (known.size() == M.rows()) M.diagonal() -= known;
  return M;
}

JointVector led_shares(const JointVector& stiffness, const ArmModel& model) {
  JointVector share = stiffness;
  for (Eigen::Index i = 0; i < share.size(); ++i) {
    const bool slides = model.is_prismatic(static_cast<std::size_t>(i));
    share[i] = std::min(1.0, stiffness[i] / (slides ? kLedFrom : kTurnedFrom));
  }
  return share;
}

ParameterSpec damping_of_parameter() {
  return choice_parameter(
      "damping_of", {"error", "velocity"},
      "What D acts on: the set-point's velocity minus the arm's, or the arm's alone, which "
      "then lags by K^-1 D times the set-point's velocity.");
}

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
