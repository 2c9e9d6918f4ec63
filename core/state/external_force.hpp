#pragma once

#include "core/state/arm_state.hpp"
#include "core/types/joints.hpp"

namespace multipanda {

// Estimates the wrench that an arm exerts on its environment from its joint torque sensors and its model, for
// arms whose backend does not provide it. A momentum observer (De Luca, Mattone 2005): with p = M dq and
//   dp/dt = tau_J + (C^T dq - g) + tau_on_arm
// the residual r follows tau_on_arm as a first-order low-pass of `bandwidth_hz` without needing ddq:
//   r_k = (r_k-1 + K (p_k - p_k-1 - dt (tau_J + mean(C^T dq - g)))) / (1 + K dt),   K = 2 pi bandwidth
// (backward Euler: stable for any dt; tau_J is the mean over the period). The signs are those of the arm's
// own interface: tau_ext_hat = -r = tau_J - model, F_hat = -F_on_arm; resting on a table gives F_hat_z < 0.
//
// tau_J is measured behind gears and motor friction, so the estimate does not contain friction. It does
// contain a load that was not declared.
class ExternalForceObserver {
 public:
  static constexpr double kBandwidth = 30;  // [Hz]

  explicit ExternalForceObserver(std::size_t joint_count, double bandwidth_hz = kBandwidth);

  // Resets the estimate to zero.
  void reset();

  // The model at the packet's state (core/model/model_terms.hpp).
  struct Model {
    const JointVector& momentum;  // M dq (n x 1) [N m s]
    const JointVector& drift;     // C^T dq - g (n x 1) [N m]
    const Jacobian& J_V_WK;       // at K, world axes (6 x n)
  };
  // Takes a fresh packet; fills tau_ext_hat, F_K_W_est and has_wrench_estimate. Loop thread, no allocation.
  // States that are not finite leave the estimate as it was.
  void update(const Model& model, ArmState& state);

 private:
  double rate_;                   // K [1/s]
  JointVector residual_;          // r [N m]
  JointVector momentum_, drift_;  // of the previous packet
  RobotTime t_;                   // of the previous packet
  std::uint32_t config_version_ = 0;
  bool started_ = false;
};

// The wrench at K, world axes, whose joint torques J^T F approximate tau best: F = (J J^T + eps)^-1 J tau.
// Exact for a force on the hand or tool in regular poses; eps bounds it in singular ones. A force on another
// link appears as a wrench at K.
Wrench wrench_of(const Jacobian& J_V_WK, const JointVector& tau);

}  // namespace multipanda
