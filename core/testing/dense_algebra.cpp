#include "core/testing/dense_algebra.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>

namespace multipanda::test {

using Eigen::MatrixXd;

MatrixXd inverse(const MatrixXd& A) { return A.inverse(); }

Eigen::VectorXd least_squares(const MatrixXd& A, const Eigen::VectorXd& b) {
  return A.colPivHouseholderQr().solve(b);
}

Eigen::VectorXcd eigenvalues(const MatrixXd& A) { return A.eigenvalues(); }

Eigen::VectorXd symmetric_eigenvalues(const MatrixXd& A) {
  return Eigen::SelfAdjointEigenSolver<MatrixXd>(A, Eigen::EigenvaluesOnly).eigenvalues();
}

Eigen::VectorXd singular_values(const MatrixXd& A) { return Eigen::JacobiSVD<MatrixXd>(A).singularValues(); }

Eigen::VectorXd null_direction(const MatrixXd& A) {
  return Eigen::JacobiSVD<MatrixXd>(A, Eigen::ComputeFullV).matrixV().rightCols(1);
}

MatrixXd floored_symmetric_inverse(const MatrixXd& A, double floor) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(A);
  const Eigen::VectorXd inverses = eigen.eigenvalues().cwiseMax(floor).cwiseInverse();
  return eigen.eigenvectors() * inverses.asDiagonal() * eigen.eigenvectors().transpose();
}

MatrixXd square_root(const MatrixXd& A) {
  const Eigen::EigenSolver<MatrixXd> modes(A);
  const Eigen::MatrixXcd V = modes.eigenvectors();
  const Eigen::VectorXcd roots = modes.eigenvalues().cwiseSqrt();
  return (V * roots.asDiagonal() * V.inverse()).real();
}

MatrixXd symmetric_square_root(const MatrixXd& A) {
  return Eigen::SelfAdjointEigenSolver<MatrixXd>(A).operatorSqrt();
}

MatrixXd task_inertia(const MatrixXd& J, const MatrixXd& M) {
  return inverse(J * inverse(M) * J.transpose());
}

MatrixXd null_space_projector(const MatrixXd& J, const MatrixXd& M) {
  return MatrixXd::Identity(M.rows(), M.rows()) - J.transpose() * task_inertia(J, M) * J * inverse(M);
}

MatrixXd modal_damping(const MatrixXd& M, const MatrixXd& K, double zeta) {
  return 2 * zeta * M * square_root(inverse(M) * K);
}

}  // namespace multipanda::test
