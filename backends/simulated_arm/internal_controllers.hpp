#pragma once

#include <optional>

#include "core/model/model_terms.hpp"
#include "models/robot_description.hpp"

namespace multipanda {

// The arm's own controllers: the torque (without gravity) that follows the desired motion like a spring.
//
// Joint impedance, e = q_d - q:
//   tau = K_f e + D (dq_d - dq) + tau_s + M ddq_f + tau_f(dq_d) + C dq,   tau_s + T dtau_s/dt = (K - K_f) e
// Cartesian impedance, e = [p_d - p; log(R_d R^T)] at K's origin, in the axes of the desired K:
//   F = K_f e + D (V_d - V) + F_s + Lambda A_f,   tau = J^T F + tau_null + tau_f(dq_d) + C dq,
//   tau_null: towards q_d, within the null space of the end effector: M (w_n^2 (q_d - q) + 2 w_n (dq_d -
//   dq)).
// The static deflection of an arm is force / K. A light joint on a stiff spring oscillates faster than the
// motors can follow (2000 N m/rad on 0.01 kg m^2: 70 Hz), so K is split in two parts. Along each natural mode
// of (M, K), or (Lambda, K_x), with stiffness k and inertia 1: K_f = min(k, w^2), w = kBandwidth; D is
// critical for K_f; and the rest, K - K_f, follows through a low-pass filter slow enough to be stable:
// 1/T = min(kSlowest.., kIntegral w^3 / (k - w^2)). For k <= w^2 this is a critically damped spring. ddq_f,
// A_f: the desired acceleration behind a first-order filter of kFeedforward.
//
// tau_f: the friction of the arm's own joints, if any; Franka's controllers compensate it. Zero at rest.
//
// Stable at 1 kHz with a torque bandwidth of 50 Hz and 1 ms of delay. Loop thread; no allocation.
class InternalControllers {
 public:
  static constexpr double kBandwidth = 60;  // [rad/s]
  static constexpr double kIntegral = 0.25;
  static constexpr double kFeedforward = 100;  // [rad/s]
  static constexpr double kNullSpace = 20;     // w_n [rad/s]

  // rotor_inertia: added to the diagonal of M [kg m^2] (n x 1); empty: none.
  explicit InternalControllers(std::size_t joint_count, std::optional<JointFriction> friction = {},
                               JointVector rotor_inertia = {});

  // Starts a motion: resets the slow part and the filters.
  void start();

  // terms: updated at the measured q, dq, with the active frames and loads. q_d, dq_d, ddq_d (n x 1),
  // stiffness K_theta (n x 1) [N m/rad].
  const JointVector& joint_impedance(ModelTerms& terms, const JointVector& q_d, const JointVector& dq_d,
                                     const JointVector& ddq_d, const JointVector& stiffness);
  // X_BE_d, V_BE_d, A_BE_d of the end effector in the base; stiffness K_x in K [N/m, N m/rad].
  const JointVector& cartesian_impedance(ModelTerms& terms, const Pose& X_EK, const Pose& X_BE_d,
                                         const Twist& V_BE_d, const Vector6& A_BE_d, const JointVector& q_d,
                                         const JointVector& dq_d, const Vector6& stiffness);

 private:
  void add_friction(const JointVector& dq_d);
  const JointMatrix& inertia(ModelTerms& terms);

  std::optional<JointFriction> friction_;
  JointVector rotor_inertia_;
  JointMatrix M_;
  JointVector tau_, tau_slow_, ddq_filtered_;
  Vector6 F_slow_ = Vector6::Zero(), A_filtered_ = Vector6::Zero();
};

}  // namespace multipanda
