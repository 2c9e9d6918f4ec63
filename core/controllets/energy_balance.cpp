#include "core/controllets/energy_balance.hpp"

namespace multipanda {

void EnergyBalance::start(const JointVector& q) {
  q_ = q;
  for (auto& tau : tau_) tau = JointVector::Zero(q.size());
  work_.fill(0);
  others_ = 0;
}

void EnergyBalance::close(const JointVector& q, const JointVector& tau_in_use) {
  const JointVector dq = q - q_;
  double sum = 0;
  for (std::size_t i = 0; i < kTorqueParts; ++i) sum += work_[i] = tau_[i].dot(dq);
  others_ = tau_in_use.size() == dq.size() ? tau_in_use.dot(dq) - sum : 0.0;
  q_ = q;
}

void TankBalance::start(std::span<const OwnedArm> arms, double tank_start_j, const TankLimits& limits) {
  for (std::size_t i = 0; i < arms_.size(); ++i) arms_[i].start(arms[i].q());
  force.start(tank_start_j, limits);
  impedance.start(tank_start_j, limits);
  created_ = 0;
}

void TankBalance::close(std::span<const OwnedArm> arms, double stored_j, ValveLaw law,
                        const TankLimits& limits) {
  for (std::size_t i = 0; i < arms_.size(); ++i) arms_[i].close(arms[i].q(), arms[i].state->tau_J_d);
  double spent = work(kSpringPart) + stored_j + work(kDampingPart) + work(kFeedforwardPart) +
                 work(kNullSpacePart) + work(kCoriolisPart);
  for (const auto& arm : arms_) spent += arm.work_of_others();
  impedance.give(spent);
  force.give(work(kForcePart) + work(kForceDampingPart));
  if (law == ValveLaw::paper) created_ += force.make_up(limits) + impedance.make_up(limits);
}

double TankBalance::work(TorquePart part) const {
  double sum = 0;
  for (const auto& arm : arms_) sum += arm.work(part);
  return sum;
}

double TankBalance::work_of_others() const {
  double sum = 0;
  for (const auto& arm : arms_) sum += arm.work_of_others();
  return sum;
}

void TankBalance::show_powers(std::span<double> outputs, double dt) const {
  const double per_s = 1.0 / dt;
  for (std::size_t i = 0; i < kTorqueParts; ++i) outputs[i] = work(static_cast<TorquePart>(i)) * per_s;
}

JointVector EnergyBalance::sum() const {
  JointVector tau = tau_[0];
  for (std::size_t i = 1; i < kTorqueParts; ++i) tau += tau_[i];
  return tau;
}

}  // namespace multipanda
