#include "core/controllets/cooperative_frame.hpp"

#include <Eigen/LU>

#include "core/controllets/task_spring.hpp"

namespace multipanda {
namespace {

// Maps the twist of E to the point at r = p_A - p_E on its body, then scales it (linear) and maps it
// (angular):
//   [scale I, 0; 0, map] [I, -skew(r); 0, I]
Matrix6 block(double scale, const Matrix3& map, const Vector3& r) {
  Matrix6 L = Matrix6::Zero();
  L.topLeftCorner<3, 3>() = scale * Matrix3::Identity();
  L.topRightCorner<3, 3>() = -scale * skew(r);
  L.bottomRightCorner<3, 3>() = map;
  return L;
}

}  // namespace

CooperativeFrame::CooperativeFrame(const Pose& X_WE1, const Pose& X_E1A, const Pose& X_WE2,
                                   const Pose& X_E2A) {
  const Pose X_WA1 = X_WE1 * X_E1A;
  const Pose X_WA2 = X_WE2 * X_E2A;
  const Vector3 phi = log_rotation(X_WA2.rotation * X_WA1.rotation.transpose());
  const Matrix3 R_half = exp_rotation(0.5 * phi);
  X_WA = {R_half * X_WA1.rotation, 0.5 * (X_WA1.position + X_WA2.position)};
  relative << X_WA2.position - X_WA1.position, phi;

  // R_2 = exp(phi) R_1:    dphi/dt = B omega_2 - B exp(phi) omega_1, B = J_l(phi)^-1, B exp(phi) = B^T.
  // R_a = exp(phi/2) R_1:  omega_a = 1/2 J_l(phi/2) dphi/dt + exp(phi/2) omega_1.
  const Matrix3 B = inverse_left_jacobian(phi);
  const Matrix3 H = 0.5 * left_jacobian(0.5 * phi);
  const Vector3 r_1 = X_WA1.position - X_WE1.position;
  const Vector3 r_2 = X_WA2.position - X_WE2.position;
  L_a1 = block(0.5, R_half - H * B.transpose(), r_1);
  L_a2 = block(0.5, H * B, r_2);
  L_r1 = block(-1.0, -B.transpose(), r_1);
  L_r2 = block(1.0, B, r_2);
}

Matrix12 CooperativeFrame::inertia(const Matrix6& Lambda_1, const Matrix6& Lambda_2) const {
  Matrix12 L, Lambda = Matrix12::Zero();
  L << L_a1, L_a2, L_r1, L_r2;
  Lambda.topLeftCorner<6, 6>() = Lambda_1;
  Lambda.bottomRightCorner<6, 6>() = Lambda_2;
  const Matrix12 L_inverse = Eigen::PartialPivLU<Matrix12>(L).inverse();
  return L_inverse.transpose() * (Lambda * L_inverse);
}

}  // namespace multipanda
