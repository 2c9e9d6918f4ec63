#include "core/model/task_space.hpp"

#include <array>
#include <cmath>

#include <Eigen/Eigenvalues>

#include "core/model/coupled_modes.hpp"
#include "core/types/capacity.hpp"
#include "core/types/spatial.hpp"
#include "core/types/triangular.hpp"

namespace multipanda {

namespace {

constexpr double kRounding = 1e-12;  // eps; halves the inverse at a singular value of 1e-6

}  // namespace

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

Vector6 eigenvalues(const Matrix6& A) {
  return Eigen::SelfAdjointEigenSolver<Matrix6>(A, Eigen::EigenvaluesOnly).eigenvalues();
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

void compute_manipulability(const Jacobian& J, Manipulability& result) {
  const Eigen::Index n = J.cols();
  const Matrix6 JJt = J.lazyProduct(J.transpose());
  Matrix6 L;
  cholesky_factor<Matrix6>(JJt + kRounding * Matrix6::Identity(), L);
  double m = 1;
  for (Eigen::Index i = 0; i < 6; ++i) m *= L(i, i);
  // With fewer than six joints, or at a singular pose, only eps remains.
  result.value = m;
  Matrix6 half = Matrix6::Identity();  // L^-T
  divide_by_transposed_lower(L, half);
  const Matrix6 inverse = half * half.transpose();
  result.J_dual.resize(6, n);
  result.J_dual.noalias() = inverse.lazyProduct(J);

  // tr(G dJ/dq_k J^T) = sum over j of (dJ_j/dq_k) . D_j with D = G J, D_j = [a_j; b_j].
  std::array<Vector3, kMaxJoints> before;  // sum over j < k of a_j x w_j
  Vector3 sum = Vector3::Zero();
  for (Eigen::Index k = 0; k < n; ++k) {
    before[static_cast<std::size_t>(k)] = sum;
    sum += Vector3(result.J_dual.col(k).head<3>()).cross(Vector3(J.col(k).tail<3>()));
  }
  result.gradient.resize(n);
  Vector3 from = Vector3::Zero();    // sum over j >= k of v_j x a_j
  Vector3 beyond = Vector3::Zero();  // sum over j > k of w_j x b_j
  for (Eigen::Index k = n - 1; k >= 0; --k) {
    const Vector3 v = J.col(k).head<3>(), w = J.col(k).tail<3>();
    const Vector3 a = result.J_dual.col(k).head<3>(), b = result.J_dual.col(k).tail<3>();
    from += v.cross(a);
    result.gradient[k] = m * (w.dot(from + beyond) + v.dot(before[static_cast<std::size_t>(k)]));
    beyond += w.cross(b);
  }
}

JointVector Manipulability::self_motion(const Jacobian& J, const JointVector& dq) const {
  const Eigen::Matrix<double, 6, 1> v = J.lazyProduct(dq);
  return dq - J_dual.transpose().lazyProduct(v);
}

template <typename Matrix>
CoupledModes<Matrix>::CoupledModes(const Matrix& inertia, const Matrix& stiffness) : U(stiffness) {
  if constexpr (Matrix::RowsAtCompileTime == Eigen::Dynamic) {
    if (inertia.rows() == 7) {  // most arms; their loops have a fixed length
      const CoupledModes<Matrix7> modes(inertia, stiffness);
      L = modes.L;
      U = modes.U;
      k = modes.k;
      return;
    }
  }
  cholesky_factor(inertia, L);
  L.template triangularView<Eigen::StrictlyUpper>().setZero();
  divide_by_transposed_lower(L, U);
  U.transposeInPlace();
  divide_by_transposed_lower(L, U);
  const Eigen::SelfAdjointEigenSolver<Matrix> solver(U);
  U = solver.eigenvectors();
  k = solver.eigenvalues().cwiseMax(0.0);  // rounding may leave a mode without stiffness slightly below zero
}

template struct CoupledModes<Matrix6>;
template struct CoupledModes<Matrix7>;
template struct CoupledModes<Matrix12>;
template struct CoupledModes<JointMatrix>;

}  // namespace multipanda
