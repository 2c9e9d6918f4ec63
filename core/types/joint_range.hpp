#pragma once

#include <algorithm>
#include <cmath>
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

// The velocity limit of a control interface that depends on the joint's position: towards an end of the
// range, at the distance d from it, at most min(dq_max, max(0, sqrt(2 deceleration d) - offset)). The ends
// are the interface's own and may lie beyond the arm's position limits. Every vector (n x 1).
struct PositionBasedVelocity {
  JointVector q_min, q_max;  // [rad]
  JointVector offset;        // [rad/s]
  JointVector deceleration;  // [rad/s^2]

  // Largest velocity at q towards the upper end, and size of the largest one towards the lower end [rad/s].
  double upwards(Eigen::Index joint, double q, double dq_max) const {
    return towards_end(joint, q_max[joint] - q, dq_max);
  }
  double downwards(Eigen::Index joint, double q, double dq_max) const {
    return towards_end(joint, q - q_min[joint], dq_max);
  }

 private:
  double towards_end(Eigen::Index joint, double d, double dq_max) const {
    const double allowed = std::sqrt(2 * deceleration[joint] * std::max(0.0, d)) - offset[joint];
    return std::clamp(allowed, 0.0, dq_max);
  }
};

}  // namespace multipanda
