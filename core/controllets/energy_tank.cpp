#include "core/controllets/energy_tank.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace multipanda {

void EnergyTank::start(double energy_j, const TankLimits& limits) {
  max_ = limits.max_j;
  energy_ = std::clamp(energy_j, limits.min_j, std::max(limits.min_j, limits.max_j));
  lost_ = 0;
}

void EnergyTank::give(double work_j) {
  energy_ -= work_j;
  // A full tank dissipates the rest. A tank above a lowered limit keeps its energy.
  if (work_j < 0 && energy_ > max_) {
    const double kept = std::max(max_, energy_ + work_j);
    lost_ += energy_ - kept;
    energy_ = kept;
  }
}

double EnergyTank::valve(const TankLimits& limits) const {
  const double u = std::clamp((energy_ - limits.min_j) / limits.closing_j, 0.0, 1.0);
  return u * u * (3.0 - 2.0 * u);
}

double EnergyTank::affordable(double work_j, double share, const TankLimits& limits) const {
  const double available = share * std::max(0.0, energy_ - limits.min_j);
  return work_j > available ? available / work_j : 1.0;
}

double EnergyTank::make_up(const TankLimits& limits) {
  const double missing = std::max(0.0, limits.min_j - energy_);
  energy_ += missing;
  return missing;
}

double contact_shape(double distance_m, double d_max_m) {
  const double s = distance_m / d_max_m;
  return std::exp(-s * s);
}

double incoming_speed_for(double force_n, double gamma, double alpha_f, double damping) {
  constexpr double kSteepest = 1.5;  // of the smooth step
  const double rise = kSteepest * std::abs(force_n) * (1.0 - gamma * alpha_f);
  if (rise <= kIncomingSpeed * damping) return kIncomingSpeed;
  return damping > 0 ? rise / damping : std::numeric_limits<double>::infinity();
}

double force_share(ValveLaw law, double gamma, double alpha_f, double speed_along, double incoming_speed) {
  if (law == ValveLaw::paper) return gamma + alpha_f * (1.0 - gamma);
  const double open = gamma * alpha_f;
  const double u = std::clamp(-speed_along / incoming_speed, 0.0, 1.0);
  return open + (1.0 - open) * u * u * (3.0 - 2.0 * u);
}

}  // namespace multipanda
