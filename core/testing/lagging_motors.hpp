#pragma once

#include <functional>

#include <Eigen/Core>

#include "core/testing/test_arm.hpp"

namespace multipanda::test {

// A law at rest in q behind motors of 50 Hz and a delay of `delay` periods, as the realistic plant has them
// (one period): the largest modulus of the linearized loop's eigenvalues per period. Below 1 it is stable.
// `torque`: of the law in a position and at a velocity (n x 1); M: inertia in q (n x n).
double growth_behind_motors(
    const std::function<JointVector(const JointVector& q, const JointVector& dq)>& torque,
    const JointVector& q, const Eigen::MatrixXd& M, Eigen::Index delay);

// Seeded: a posture in the inner nine tenths of every joint's range.
JointVector pose_within_limits(Draw& draw, const ArmModel& model);

}  // namespace multipanda::test
