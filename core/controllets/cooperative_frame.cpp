#include "core/controllets/cooperative_frame.hpp"

#include <algorithm>

#include <Eigen/LU>

#include "core/controllets/raised_spring.hpp"

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

Eigen::Matrix<double, 12, 1> CooperativeFrame::task_coriolis(ModelTerms& first, ModelTerms& second,
                                                             const Vector6& V_d) const {
  using Vector12 = Eigen::Matrix<double, 12, 1>;
  Matrix12 L;
  L << L_a1, L_a2, L_r1, L_r2;
  const Matrix12 L_inverse = Eigen::PartialPivLU<Matrix12>(L).inverse();
  const Vector12 V = L_inverse.leftCols<6>() * V_d;  // of both hands
  Vector12 F;
  F << first.task_coriolis(V.head<6>()), second.task_coriolis(V.tail<6>());
  return L_inverse.transpose() * F;
}

Matrix12 given_damping(const CooperativeFrame& frame, OwnedArm& first, OwnedArm& second,
                       const Matrix6& absolute, const Matrix6& relative) {
  Matrix12 D = Matrix12::Zero();
  D.topLeftCorner<6, 6>() = absolute;
  D.bottomRightCorner<6, 6>() = relative;
  limit_modes(frame.inertia(damped_inertia(*first.terms), damped_inertia(*second.terms)),
              kLargestModalDamping, D);
  return D;
}

double soften(const CooperativeFrame& frame, OwnedArm& first, OwnedArm& second, const Matrix3& R_d,
              const Matrix12& Lambda, ImpedanceGains& absolute, ImpedanceGains& relative) {
  Matrix12 K = Matrix12::Zero(), L;
  K.topLeftCorner<6, 6>() = absolute.stiffness(R_d).matrix();
  K.bottomRightCorner<6, 6>() = relative.stiffness(R_d).matrix();
  constexpr double kMost = 200.0 * 200.0;  // [1/s^2]
  if (cholesky_factor<Matrix12>(kMost * Lambda - K, L)) return 1;
  const Matrix12 whole = frame.inertia(damped_inertia(*first.terms), damped_inertia(*second.terms));
  const double share = std::min(1.0, kMost / CoupledModes<Matrix12>(whole, K).k.maxCoeff());
  for (ImpedanceGains* gains : {&absolute, &relative}) {
    gains->translational_stiffness *= share;
    gains->rotational_stiffness *= share;
  }
  return share;
}

void brake(const Matrix3& R_d, const ImpedanceGains& absolute, const ImpedanceGains& relative,
           const Matrix12& Lambda, Matrix12& D) {
  if (absolute.leads() && relative.leads()) return;
  D.topLeftCorner<6, 6>() += absolute.brake(R_d, Lambda.topLeftCorner<6, 6>());
  D.bottomRightCorner<6, 6>() += relative.brake(R_d, Lambda.bottomRightCorner<6, 6>());
  limit_modes(Lambda, kLargestModalDamping, D);
}

CartesianTarget come_back(RaisedSpring& absolute, RaisedSpring& relative, const CartesianTarget& rule,
                          const ControlContext& context) {
  if (absolute.none() && relative.none()) return rule;
  double lever = 0;
  for (const OwnedArm& arm : context.arms)
    lever = std::max(lever,
                     (arm.terms->X_WE().position - rule.X_W_d.position).norm() + farthest_point(*arm.terms));
  const double most = context.contact.hand_speed;
  absolute.come_back(rule.V_d.vector, most, lever, context.dt);
  const CartesianTarget seen = absolute.seen(rule);
  const double moved = seen.V_d.linear().norm() + lever * seen.V_d.angular().norm();
  relative.come_back(Vector6::Zero(), 2 * std::max(0.0, most - moved), lever, context.dt);
  return seen;
}

InputSpec shared_frame_input() {
  return {
      .name = "pose",
      .quantity = Quantity::pose,
      .arm = 0,
      .doc =
          "Set-point X_WA of the shared frame A, world frame; begins midway between the hands, with the axes "
          "of the world."};
}

ParameterSpec relative_translational_stiffness_parameter() {
  return {.name = "relative_translational_stiffness_n_per_m",
          .unit = "N/m",
          .size = 3,
          .initial = {400, 400, 400},
          .max = 5000,
          .doc = "Stiffness between the hands along x, y, z; none along a squeeze that holds an object."};
}

ParameterSpec relative_rotational_stiffness_parameter() {
  return {.name = "relative_rotational_stiffness_nm_per_rad",
          .unit = "N m/rad",
          .size = 3,
          .initial = {20, 20, 20},
          .max = 300,
          .doc = "Stiffness between the hands about x, y, z."};
}

ParameterSpec relative_translational_damping_parameter() {
  return {.name = "relative_translational_damping_n_s_per_m",
          .unit = "N s/m",
          .size = 3,
          .initial = {40, 40, 40},
          .max = 1000,
          .doc = "Damping between the hands along x, y, z if damping_design is 'given'."};
}

ParameterSpec relative_rotational_damping_parameter() {
  return {.name = "relative_rotational_damping_nm_s_per_rad",
          .unit = "N m s/rad",
          .size = 3,
          .initial = {7.2, 7.2, 7.2},
          .max = 100,
          .doc = "The same about x, y, z."};
}

Preset coupled_paper_preset(std::vector<Preset::Value> more) {
  std::vector<Preset::Value> values{{"translational_stiffness_n_per_m", {200, 200, 100}},  // of A: both arms
                                    {"rotational_stiffness_nm_per_rad", {20}},
                                    {"relative_translational_stiffness_n_per_m", {50, 50, 25}},
                                    {"relative_rotational_stiffness_nm_per_rad", {5}}};
  values.insert(values.end(), more.begin(), more.end());
  return paper_preset(std::move(values));
}

}  // namespace multipanda
