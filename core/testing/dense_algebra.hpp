#pragma once

#include <Eigen/Core>

namespace multipanda::test {

// Textbook algebra with Eigen's solvers, compiled once: each solver takes seconds in every file that uses it.
Eigen::MatrixXd inverse(const Eigen::MatrixXd& A);
Eigen::VectorXd least_squares(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);
Eigen::VectorXcd eigenvalues(const Eigen::MatrixXd& A);
Eigen::VectorXd symmetric_eigenvalues(const Eigen::MatrixXd& A);
Eigen::VectorXd singular_values(const Eigen::MatrixXd& A);
Eigen::VectorXd null_direction(const Eigen::MatrixXd& A);  // of unit length, A with a column more than rows
// The inverse of a symmetric A whose eigenvalues are raised to at least `floor`.
Eigen::MatrixXd floored_symmetric_inverse(const Eigen::MatrixXd& A, double floor);
// R with R R = A, by the eigenvectors of an unsymmetric A with positive eigenvalues.
Eigen::MatrixXd square_root(const Eigen::MatrixXd& A);
// The same for a symmetric A.
Eigen::MatrixXd symmetric_square_root(const Eigen::MatrixXd& A);
// (J M^-1 J')^-1, and the projector I - J' Lambda J M^-1 of torques.
Eigen::MatrixXd task_inertia(const Eigen::MatrixXd& J, const Eigen::MatrixXd& M);
Eigen::MatrixXd null_space_projector(const Eigen::MatrixXd& J, const Eigen::MatrixXd& M);
// 2 zeta M sqrt(M^-1 K): every mode of M x'' + D x' + K x = 0 with the damping ratio zeta.
Eigen::MatrixXd modal_damping(const Eigen::MatrixXd& M, const Eigen::MatrixXd& K, double zeta);

}  // namespace multipanda::test
