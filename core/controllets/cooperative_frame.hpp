#pragma once

#include "core/controllets/controllet.hpp"
#include "core/model/coupled_modes.hpp"

namespace multipanda {

class RaisedSpring;
struct CartesianTarget;
struct ImpedanceGains;

// Cooperative coordinates of two hands that share a frame A. Each hand E_i carries A at a fixed offset
// X_EiA, so both have an estimate X_WA_i = X_WEi X_EiA of it. With phi = log(R_2 R_1^T):
//   absolute pose   p_a = (p_1 + p_2) / 2,   R_a = exp(phi / 2) R_1     (geodesic mean)
//   relative pose   p_r = p_2 - p_1,         phi                        (world axes)
// Rates: V_a the twist of A, V_r = [dp_r/dt; dphi/dt]. L is the Jacobian of these coordinates, not an
// approximation for small phi:
//   [V_a; V_r] = [L_a1 L_a2; L_r1 L_r2] [V_WE1; V_WE2]
// so [F_1; F_2] = L^T [F_a; F_r] conserves power exactly. While the estimates nearly coincide, phi is near 0
// for any orientation of the hands, also if they face each other. The coordinates are meaningless near |phi|
// = pi.
struct CooperativeFrame {
  CooperativeFrame(const Pose& X_WE1, const Pose& X_E1A, const Pose& X_WE2, const Pose& X_E2A);

  Vector6 absolute_velocity(const Vector6& V_WE1, const Vector6& V_WE2) const {
    return L_a1 * V_WE1 + L_a2 * V_WE2;
  }
  Vector6 relative_velocity(const Vector6& V_WE1, const Vector6& V_WE2) const {
    return L_r1 * V_WE1 + L_r2 * V_WE2;
  }
  Vector6 first_wrench(const Vector6& F_a, const Vector6& F_r) const {
    return L_a1.transpose() * F_a + L_r1.transpose() * F_r;
  }
  Vector6 second_wrench(const Vector6& F_a, const Vector6& F_r) const {
    return L_a2.transpose() * F_a + L_r2.transpose() * F_r;
  }

  // Inertia in these coordinates of two hands with task inertias Lambda_1, Lambda_2: L^-T diag(Lambda_i)
  // L^-1.
  Matrix12 inertia(const Matrix6& Lambda_1, const Matrix6& Lambda_2) const;

  // C_c V_d of both hands in these coordinates (12 x 1) [N, N m], for a rigid motion of A with the twist V_d:
  // L^-T of what each hand needs; dL/dt is left out.
  Eigen::Matrix<double, 12, 1> task_coriolis(ModelTerms& first, ModelTerms& second, const Vector6& V_d) const;

  // If the orientations of the two estimates of A differ by more than this, the object slipped or broke. A
  // pose that is not finite is treated in the same way.
  static constexpr double kLargestRelativeAngle = 2.0;  // [rad]
  bool holds_together() const { return relative.tail<3>().norm() < kLargestRelativeAngle; }

  Pose X_WA;         // absolute
  Vector6 relative;  // [p_r; phi]
  Matrix6 L_a1, L_a2, L_r1, L_r2;
};

// D (12 x 12) of given dampings of A and between the hands, each mode limited by the inertia of both hands,
// motors included.
Matrix12 given_damping(const CooperativeFrame& frame, OwnedArm& first, OwnedArm& second,
                       const Matrix6& absolute, const Matrix6& relative);

// Softens the springs of A and between the hands, all by one factor, until no mode of the inertia of both
// hands, `Lambda` (12 x 12) with the motors that the models state, is faster than 200 rad/s: hands far apart
// turn a light wrist on a long lever, faster than kFastestMode with usual gains. Behind motors of 50 Hz and
// one period such a mode decays. Returns the factor. `R_d`: axes of the set-point.
double soften(const CooperativeFrame& frame, OwnedArm& first, OwnedArm& second, const Matrix3& R_d,
              const Matrix12& Lambda, ImpedanceGains& absolute, ImpedanceGains& relative);

// Adds ImpedanceGains::brake() of both to D (12 x 12), limited by the inertia.
void brake(const Matrix3& R_d, const ImpedanceGains& absolute, const ImpedanceGains& relative,
           const Matrix12& Lambda, Matrix12& D);

// One tick in which the raised springs of A and between the hands return (raised_spring.hpp); the set-point
// that A sees. A hand moves with A and by half of the distance between them, which gets its remaining speed.
CartesianTarget come_back(RaisedSpring& absolute, RaisedSpring& relative, const CartesianTarget& rule,
                          const ControlContext& context);

// --- descriptor parts shared by laws of two coupled hands ---
InputSpec shared_frame_input();  // X_WA
ParameterSpec relative_translational_stiffness_parameter();
ParameterSpec relative_rotational_stiffness_parameter();
ParameterSpec relative_translational_damping_parameter();
ParameterSpec relative_rotational_damping_parameter();
// The impedance as the paper prints it, of A and between the hands; `more` is appended.
Preset coupled_paper_preset(std::vector<Preset::Value> more = {});

}  // namespace multipanda
