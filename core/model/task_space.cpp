#include "core/model/task_space.hpp"

#include <algorithm>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

namespace multipanda {

// The eigenvalues are only computed where the floor acts: A - floor * I has a Cholesky factor exactly when
// all lie above it.
Matrix6 floored_inverse(const Matrix6& A, bool& floored) {
  constexpr double kFloor = TaskSpace::kMobilityFloor;
  const Eigen::LLT<Matrix6> above(A - kFloor * Matrix6::Identity());
  floored = above.info() != Eigen::Success;
  if (!floored) return Eigen::LLT<Matrix6>(A).solve(Matrix6::Identity());
  const Eigen::SelfAdjointEigenSolver<Matrix6> eigen(A);
  const Vector6 inverse = eigen.eigenvalues().cwiseMax(kFloor).cwiseInverse();
  return eigen.eigenvectors() * inverse.asDiagonal() * eigen.eigenvectors().transpose();
}

void compute_task_space(const Jacobian& J, const JointMatrix& M, TaskSpace& task) {
  with_joint_count(static_cast<std::size_t>(J.cols()), [&]<int N>() {
    using MatrixN = Eigen::Matrix<double, N, N>;
    using MatrixN6 = Eigen::Matrix<double, N, 6>;
    const Eigen::Map<const MatrixN> M_fixed(M.data());
    const Eigen::Map<const Eigen::Matrix<double, 6, N>> J_fixed(J.data());
    // L^-1 J^T gives A as one symmetric product, and M^-1 J^T by a second triangular solve.
    const Eigen::LLT<MatrixN> cholesky(M_fixed);
    MatrixN6 half = J_fixed.transpose();
    cholesky.matrixL().solveInPlace(half);
    task.mobility.noalias() = half.transpose() * half;
    task.Lambda = floored_inverse(task.mobility, task.floored);
    cholesky.matrixU().solveInPlace(half);
    task.J_bar.resize(N, 6);
    Eigen::Map<MatrixN6>(task.J_bar.data()).noalias() = half * task.Lambda;
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
