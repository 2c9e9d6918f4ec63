#pragma once

#include <Eigen/Core>

#include "core/types/capacity.hpp"

// Joint-space quantities. The size is the arm's joint count (1 to kMaxJoints) and the storage is inside the
// object: assigning, copying and resizing never allocate.
namespace multipanda {

using JointVector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMaxJoints, 1>;  // (n x 1)
using JointMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMaxJoints,
                                  kMaxJoints>;                                              // (n x n)
using Jacobian = Eigen::Matrix<double, 6, Eigen::Dynamic, Eigen::ColMajor, 6, kMaxJoints>;  // (6 x n)
using JointBy6 = Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::ColMajor, kMaxJoints, 6>;  // (n x 6)

}  // namespace multipanda
