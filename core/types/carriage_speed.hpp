#pragma once

#include <algorithm>
#include <cmath>
#include <span>

#include "core/types/joints.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

// Speed of the fastest carriage, which is what a prismatic joint moves [m/s], at the joint velocities `dq` (n
// numbers); 0 without prismatic joints. Their columns of a hand's Jacobian `J` (6 x n) are unit vectors that
// turn nothing. Of carriages on each other, each counts alone and with those that carry it: one that is not
// moved by its own joint may be fast, and so may the gap between two.
inline double carriage_speed(const Jacobian& J, std::span<const double> dq) {
  double fastest = 0;
  Vector3 v = Vector3::Zero();
  for (std::size_t i = 0; i < dq.size(); ++i) {
    const auto column = J.col(static_cast<Eigen::Index>(i));
    const double turns = column.tail<3>().squaredNorm(), moves = column.head<3>().squaredNorm();
    if (turns > 1e-12 || std::abs(moves - 1) > 1e-9) continue;
    v += dq[i] * column.head<3>();
    fastest = std::max({fastest, std::abs(dq[i]), v.norm()});
  }
  return fastest;
}
inline double carriage_speed(const Jacobian& J, const JointVector& dq) {
  return carriage_speed(J, std::span(dq.data(), static_cast<std::size_t>(dq.size())));
}

}  // namespace multipanda
