#include "sysid/identification/inertial_parameters.hpp"

#include <cmath>
#include <limits>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

namespace multipanda {
namespace {

Matrix3 inertia_about_origin(const Theta& t) {
  Matrix3 I;
  I << t[4], t[5], t[7], t[5], t[6], t[8], t[7], t[8], t[9];
  return I;
}

Matrix3 point(double mass, const Vector3& c) {
  return mass * (c.squaredNorm() * Matrix3::Identity() - c * c.transpose());
}

// dP/dtheta_k.
const std::array<Eigen::Matrix4d, 10>& directions() {
  static const std::array<Eigen::Matrix4d, 10> all = [] {
    std::array<Eigen::Matrix4d, 10> out;
    for (int k = 0; k < 10; ++k) out[static_cast<std::size_t>(k)] = pseudo_inertia(Theta::Unit(k));
    return out;
  }();
  return all;
}

}  // namespace

Theta theta_of(const RigidBody& body) {
  const Matrix3 I = body.inertia + point(body.mass, body.com);
  Theta t;
  t << body.mass, body.mass * body.com, I(0, 0), I(0, 1), I(1, 1), I(0, 2), I(1, 2), I(2, 2);
  return t;
}

RigidBody body_of(const Theta& theta) {
  const Vector3 com = theta.segment<3>(1) / theta[0];
  return {theta[0], com, inertia_about_origin(theta) - point(theta[0], com)};
}

Eigen::Matrix4d pseudo_inertia(const Theta& theta) {
  const Matrix3 I = inertia_about_origin(theta);
  Eigen::Matrix4d P;
  P.topLeftCorner<3, 3>() = 0.5 * I.trace() * Matrix3::Identity() - I;
  P.topRightCorner<3, 1>() = theta.segment<3>(1);
  P.bottomLeftCorner<1, 3>() = theta.segment<3>(1).transpose();
  P(3, 3) = theta[0];
  return P;
}

RigidBody floored(const RigidBody& body, double floor) {
  const Matrix3 S = 0.5 * body.inertia.trace() * Matrix3::Identity() - body.inertia;
  const Eigen::SelfAdjointEigenSolver<Matrix3> solver(S);
  const Matrix3 lifted = solver.eigenvectors() * solver.eigenvalues().cwiseMax(floor).asDiagonal() *
                         solver.eigenvectors().transpose();
  return {body.mass, body.com, lifted.trace() * Matrix3::Identity() - lifted};
}

Divergence::Divergence(const Theta& prior) {
  const Eigen::Matrix4d P0 = pseudo_inertia(prior);
  inverse_ = P0.inverse();
  log_det_ = std::log(P0.determinant());
  for (int k = 0; k < 10; ++k) trace_[k] = (inverse_ * directions()[static_cast<std::size_t>(k)]).trace();
}

double Divergence::value(const Theta& theta, Theta* gradient, Eigen::Matrix<double, 10, 10>* hessian) const {
  const Eigen::Matrix4d P = pseudo_inertia(theta);
  const Eigen::LLT<Eigen::Matrix4d> llt(P);
  if (llt.info() != Eigen::Success) return std::numeric_limits<double>::infinity();
  const double log_det = 2 * llt.matrixLLT().diagonal().array().log().sum();
  if (!std::isfinite(log_det)) return std::numeric_limits<double>::infinity();
  if (gradient != nullptr) {
    const Eigen::Matrix4d inverse = llt.solve(Eigen::Matrix4d::Identity());
    std::array<Eigen::Matrix4d, 10> M;
    for (std::size_t k = 0; k < 10; ++k) M[k] = inverse * directions()[k];
    for (int a = 0; a < 10; ++a) {
      const Eigen::Matrix4d& Ma = M[static_cast<std::size_t>(a)];
      (*gradient)[a] = trace_[a] - Ma.trace();
      if (hessian == nullptr) continue;
      for (int b = 0; b <= a; ++b) {
        const Eigen::Matrix4d& Mb = M[static_cast<std::size_t>(b)];
        (*hessian)(a, b) = (*hessian)(b, a) = Ma.cwiseProduct(Mb.transpose()).sum();  // tr(Ma Mb)
      }
    }
  }
  return trace_.dot(theta) - (log_det - log_det_) - 4;
}

}  // namespace multipanda
