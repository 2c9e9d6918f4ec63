#include "core/controllets/teleoperation_side.hpp"

#include <algorithm>
#include <cmath>

#include "core/controllets/force_law.hpp"

namespace multipanda::teleoperation {

void Side::start(const OwnedArm& arm, double energy_j, const TankLimits& limits) {
  tank.start(energy_j, limits);
  balance.start(arm.q());
  valve = tank.valve(limits);
}

void Side::close(const OwnedArm& arm, const TankLimits& limits, double dt) {
  balance.close(arm.q(), arm.state->tau_J_d);
  tank.give(balance.work(kForcePart) + balance.work_of_others());
  valve = std::min(tank.valve(limits), valve + dt / Fade::kDuration);
}

Vector6 Side::let_through(const Vector6& pull, const Vector6& V, const Matrix6& D, const TankLimits& limits,
                          double dt) const {
  Vector6 passed = pull;
  for (const Eigen::Index first : {0, 3}) {
    const double size = pull.segment<3>(first).norm();
    if (!(size > 1e-9)) continue;
    const Vector3 n = pull.segment<3>(first) / size;
    const double damping = n.dot(D.block<3, 3>(first, first) * n);
    passed.segment<3>(first) *= force_share(ValveLaw::passive, 1, valve, n.dot(V.segment<3>(first)),
                                            incoming_speed_for(size, 1, valve, damping));
  }
  return passed * tank.affordable(passed.dot(V) * dt, 0.1, limits);
}

double bearable_share(const OwnedArm& arm, const JointVector& pull, const JointVector& rest) {
  constexpr double kShare = 0.9;  // of the limit
  const JointVector& g = arm.terms->g();
  double share = 1;
  for (Eigen::Index i = 0; i < pull.size(); ++i) {
    const double size = std::abs(pull[i]), way = pull[i] > 0 ? 1 : -1;
    const double loaded = way * rest[i] + std::max(0.0, way * g[i]);
    const double room = std::max(0.0, kShare * arm.model().limits().tau_max[i] - loaded);
    if (size > room) share = std::min(share, room / size);
  }
  return share;
}

}  // namespace multipanda::teleoperation
