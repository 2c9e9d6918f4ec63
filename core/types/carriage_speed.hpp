#pragma once

#include <algorithm>
#include <cmath>
#include <span>

#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

// Speed of the fastest carriage, which is what a prismatic joint moves [m/s], at the joint velocities `dq` (n
// numbers); 0 without prismatic joints. In a hand's Jacobian `J` (6 x n), the column of a revolute joint has
// an angular part of 1 and that of a prismatic one of 0, up to rounding. Of stacked carriages, each counts
// alone and together with those that carry it: a carriage may be fast without motion of its own joint, and so
// may the gap between two.
inline double carriage_speed(const Jacobian& J, std::span<const double> dq) {
  double fastest = 0;
  Vector3 v = Vector3::Zero();
  for (std::size_t i = 0; i < dq.size(); ++i) {
    const auto column = J.col(static_cast<Eigen::Index>(i));
    if (column.tail<3>().norm() > 0.5) continue;
    v += dq[i] * column.head<3>();
    fastest = std::max({fastest, std::abs(dq[i]), v.norm()});
  }
  return fastest;
}
inline double carriage_speed(const Jacobian& J, const JointVector& dq) {
  return carriage_speed(J, std::span(dq.data(), static_cast<std::size_t>(dq.size())));
}

}  // namespace multipanda
