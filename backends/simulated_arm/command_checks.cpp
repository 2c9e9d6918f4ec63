#include "backends/simulated_arm/command_checks.hpp"

#include <algorithm>
#include <cmath>

namespace multipanda {

TorqueRateCheck::TorqueRateCheck(const JointVector& rate_max, double period_s)
    : rate_max_(rate_max),
      last_(JointVector::Zero(rate_max.size())),
      replaced_(last_),
      published_(last_),
      period_(period_s) {}

ReflexDetail TorqueRateCheck::check(const JointVector& tau) const {
  ReflexDetail worst;
  double excess = 1 + kSlack;
  for (Eigen::Index i = 0; i < tau.size(); ++i) {
    const double step = std::min(
        {std::abs(tau[i] - last_[i]), std::abs(tau[i] - replaced_[i]), std::abs(tau[i] - published_[i])});
    const double rate = step / period_;
    if (rate <= excess * rate_max_[i]) continue;
    excess = rate / rate_max_[i];
    worst = {.error = ArmError::controller_torque_discontinuity,
             .index = static_cast<std::int8_t>(i),
             .value = rate,
             .limit = rate_max_[i]};
  }
  return worst;
}

}  // namespace multipanda
