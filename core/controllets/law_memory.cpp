#include "core/controllets/law_memory.hpp"

#include <algorithm>

#include "core/types/time.hpp"

namespace multipanda {

double rate_share(const JointVector& change, const ArmModel& model, double dt) {
  constexpr double kRateShare = 0.25;
  const JointVector most = kRateShare * std::min(dt, kArmPeriod) * model.limits().tau_rate_max;
  return std::min(1.0, most.cwiseQuotient(change.cwiseAbs()).minCoeff());
}

void RaisedSpring::update(double before, double now) {
  energy_ = std::min(energy_ + std::max(0.0, now - before), now);
  share_ = now > 0 ? energy_ / now : 0;
}

ContactBounds RaisedSpring::bounds(const ContactBounds& usual) const {
  ContactBounds bounds = usual;
  bounds.raised = share_;
  return bounds;
}

}  // namespace multipanda
