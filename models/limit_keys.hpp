#pragma once

namespace multipanda {

// Keys of a joint's limits in model files, with their units.
struct LimitKeys {
  const char *lower, *upper, *velocity, *effort;
};
inline constexpr LimitKeys kTurningLimits{"lower_rad", "upper_rad", "velocity_rad_per_s", "effort_nm"};
inline constexpr LimitKeys kSlidingLimits{"lower_m", "upper_m", "velocity_m_per_s", "effort_n"};
constexpr const LimitKeys& limit_keys(bool prismatic) { return prismatic ? kSlidingLimits : kTurningLimits; }

}  // namespace multipanda
