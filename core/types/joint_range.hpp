#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "core/types/joints.hpp"

namespace multipanda {

// The positions that the joints of an arm may take.
struct JointRange {
  JointVector min, max;         // [rad], of prismatic joints [m] (n x 1)
  std::uint32_t prismatic = 0;  // bit i: joint i

  // A limit is exceeded by more than this: numbers are rounded on their way [rad], [m].
  static constexpr double kRounding = 1e-6;
  // The first joint outside of its range; q.size(): none. A position that is not finite is outside.
  std::size_t first_outside(std::span<const double> q) const;
  // The fault of that joint as text; empty: none. Off the loop.
  std::string refusal(std::span<const double> q) const;
};

}  // namespace multipanda
