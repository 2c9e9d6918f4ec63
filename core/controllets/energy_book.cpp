#include "core/controllets/energy_book.hpp"

namespace multipanda {

void EnergyBook::start(const JointVector& q) {
  q_ = q;
  for (auto& tau : tau_) tau = JointVector::Zero(q.size());
  work_.fill(0);
  others_ = 0;
}

void EnergyBook::close(const JointVector& q, const JointVector& tau_in_use) {
  const JointVector dq = q - q_;
  double sum = 0;
  for (std::size_t i = 0; i < kTorqueParts; ++i) sum += work_[i] = tau_[i].dot(dq);
  others_ = tau_in_use.size() == dq.size() ? tau_in_use.dot(dq) - sum : 0.0;
  q_ = q;
}

JointVector EnergyBook::sum() const {
  JointVector tau = tau_[0];
  for (std::size_t i = 1; i < kTorqueParts; ++i) tau += tau_[i];
  return tau;
}

}  // namespace multipanda
