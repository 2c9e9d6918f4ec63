#include "core/model/task_space.hpp"

#include "core/model/coupled_modes.hpp"
#include "core/types/triangular.hpp"

namespace multipanda {

// The eigenvalues are computed only where the floor acts: A - floor * I has a Cholesky factor exactly when
// all eigenvalues of A lie above the floor.
Matrix6 floored_inverse(const Matrix6& A, bool& floored) {
  constexpr double kFloor = TaskSpace::kMobilityFloor;
  Matrix6 L;
  floored = !cholesky_factor<Matrix6>(A - kFloor * Matrix6::Identity(), L);
  if (!floored) {
    cholesky_factor(A, L);
    Matrix6 half = Matrix6::Identity();  // L^-T
    divide_by_transposed_lower(L, half);
    return half * half.transpose();
  }
  const CoupledModes<Matrix6> modes(Matrix6::Identity(), A);  // the eigenvalues of A itself
  const Vector6 inverse = modes.k.cwiseMax(kFloor).cwiseInverse();
  return modes.U * inverse.asDiagonal() * modes.U.transpose();
}

namespace {

// N joints, or Eigen::Dynamic for any count up to kMaxJoints.
template <int N>
void fill_task_space(const Jacobian& J, const JointMatrix& M, TaskSpace& task) {
  constexpr int kCapacity = N == Eigen::Dynamic ? static_cast<int>(kMaxJoints) : N;
  using MatrixN = Eigen::Matrix<double, N, N, Eigen::ColMajor, kCapacity, kCapacity>;
  using Matrix6N = Eigen::Matrix<double, 6, N, Eigen::ColMajor, 6, kCapacity>;
  using MatrixN6 = Eigen::Matrix<double, N, 6, Eigen::ColMajor, kCapacity, 6>;
  const Eigen::Index n = J.cols();
  // J L^-T gives A as one symmetric product, and J M^-1 by a second division.
  MatrixN L;
  cholesky_factor<MatrixN>(Eigen::Map<const MatrixN>(M.data(), n, n), L);
  Matrix6N half = Eigen::Map<const Matrix6N>(J.data(), 6, n);
  divide_by_transposed_lower(L, half);
  task.mobility.noalias() = half.lazyProduct(half.transpose());
  task.Lambda = floored_inverse(task.mobility, task.floored);
  divide_by_lower(L, half);
  task.J_bar.resize(n, 6);
  Eigen::Map<MatrixN6>(task.J_bar.data(), n, 6).noalias() = half.transpose().lazyProduct(task.Lambda);
}

}  // namespace

// The counts of the arms in use have instances of their own, whose products are unrolled. Each takes seconds
// to compile.
void compute_task_space(const Jacobian& J, const JointMatrix& M, TaskSpace& task) {
  if (J.cols() == 7) return fill_task_space<7>(J, M, task);
  if (J.cols() == 6) return fill_task_space<6>(J, M, task);
  fill_task_space<Eigen::Dynamic>(J, M, task);
}

Matrix6 TaskSpace::press() const {
  if (!floored) return Matrix6::Identity();
  const CoupledModes<Matrix6> modes(Matrix6::Identity(), mobility);
  const Vector6 ratio = modes.k.cwiseMax(kMobilityFloor).cwiseQuotient(modes.k.cwiseMax(kPressFloor));
  return modes.U * ratio.asDiagonal() * modes.U.transpose();
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
