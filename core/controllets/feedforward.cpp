#include "core/controllets/feedforward.hpp"

#include <algorithm>

#include "core/types/time.hpp"

namespace multipanda {

double rate_share(const JointVector& change, const ArmModel& model, double dt) {
  constexpr double kRateShare = 0.25;
  const JointVector most = kRateShare * std::min(dt, kArmPeriod) * model.limits().tau_rate_max;
  return std::min(1.0, most.cwiseQuotient(change.cwiseAbs()).minCoeff());
}

}  // namespace multipanda
