#pragma once

#include <array>
#include <cstddef>
#include <utility>

#include <Eigen/Core>

#include "core/types/capacity.hpp"

// Joint-space quantities. The size is the arm's joint count (1 to kMaxJoints), the storage is inside the
// object: assigning, copying and resizing never allocate.
namespace multipanda {

using JointVector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMaxJoints, 1>;  // (n x 1)
using JointMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMaxJoints,
                                  kMaxJoints>;                                              // (n x n)
using Jacobian = Eigen::Matrix<double, 6, Eigen::Dynamic, Eigen::ColMajor, 6, kMaxJoints>;  // (6 x n)
using JointBy6 = Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::ColMajor, kMaxJoints, 6>;  // (n x 6)

// Up to this many joints an arm's matrix products are unrolled for its own count; above it one version serves
// every count, with storage for kMaxJoints. Sixteen unrolled sizes took minutes to compile.
inline constexpr std::size_t kMaxUnrolledJoints = 8;

// Runs `work.template operator()<N>()` with N equal to `count` as a compile-time constant, so that small
// matrix products are unrolled for whatever arm this is; N is Eigen::Dynamic above kMaxUnrolledJoints.
template <typename Work>
void with_joint_count(std::size_t count, Work&& work) {
  if (count > kMaxUnrolledJoints) return work.template operator()<Eigen::Dynamic>();
  [&]<std::size_t... I>(std::index_sequence<I...>) {
    (void)((count == I + 1 && (work.template operator()<static_cast<int>(I + 1)>(), true)) || ...);
  }
  (std::make_index_sequence<kMaxUnrolledJoints>{});
}

}  // namespace multipanda
