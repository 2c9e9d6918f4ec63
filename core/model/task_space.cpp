#include "core/model/task_space.hpp"

#include <algorithm>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include "core/types/triangular.hpp"

namespace multipanda {

// The eigenvalues are only computed where the floor acts: A - floor * I has a Cholesky factor exactly when
// all lie above it.
Matrix6 floored_inverse(const Matrix6& A, bool& floored) {
  constexpr double kFloor = TaskSpace::kMobilityFloor;
  const Eigen::LLT<Matrix6> above(A - kFloor * Matrix6::Identity());
  floored = above.info() != Eigen::Success;
  if (!floored) {
    const Eigen::LLT<Matrix6> cholesky(A);
    Matrix6 half = Matrix6::Identity();  // L^-T
    divide_by_transposed_lower(cholesky.matrixLLT(), half);
    return half * half.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Matrix6> eigen(A);
  const Vector6 inverse = eigen.eigenvalues().cwiseMax(kFloor).cwiseInverse();
  return eigen.eigenvectors() * inverse.asDiagonal() * eigen.eigenvectors().transpose();
}

void compute_task_space(const Jacobian& J, const JointMatrix& M, TaskSpace& task) {
  with_joint_count(static_cast<std::size_t>(J.cols()), [&]<int N>() {
    constexpr int kCapacity = N == Eigen::Dynamic ? static_cast<int>(kMaxJoints) : N;
    using MatrixN = Eigen::Matrix<double, N, N, Eigen::ColMajor, kCapacity, kCapacity>;
    using Matrix6N = Eigen::Matrix<double, 6, N, Eigen::ColMajor, 6, kCapacity>;
    const Eigen::Index n = J.cols();
    const Eigen::Map<const MatrixN> M_sized(M.data(), n, n);
    // J L^-T gives A as one symmetric product, and J M^-1 by a second division.
    const Eigen::LLT<MatrixN> cholesky(M_sized);
    Matrix6N half = Eigen::Map<const Matrix6N>(J.data(), 6, n);
    divide_by_transposed_lower(cholesky.matrixLLT(), half);
    task.mobility.noalias() = half.lazyProduct(half.transpose());
    task.Lambda = floored_inverse(task.mobility, task.floored);
    divide_by_lower(cholesky.matrixLLT(), half);
    task.J_bar.resize(n, 6);
    constexpr auto kOrder = N == 1 ? Eigen::RowMajor : Eigen::ColMajor;  // Eigen's rule for a single row
    using MatrixN6 = Eigen::Matrix<double, N, 6, kOrder, kCapacity, 6>;
    Eigen::Map<MatrixN6>(task.J_bar.data(), n, 6).noalias() = half.transpose().lazyProduct(task.Lambda);
  });
}

JointVector TaskSpace::null_space_torque(const Jacobian& J, const JointVector& tau) const {
  const Vector6 f = J_bar.transpose().lazyProduct(tau);
  return tau - J.transpose().lazyProduct(f);
}

JointVector TaskSpace::null_space_velocity(const Jacobian& J, const JointVector& dq) const {
  const Vector6 v = J.lazyProduct(dq);
  return dq - J_bar.lazyProduct(v);
}

}  // namespace multipanda
