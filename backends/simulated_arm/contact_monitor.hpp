#pragma once

#include "arm_interface/arm_error.hpp"
#include "core/cycle/backend.hpp"
#include "core/model/model_terms.hpp"
#include "core/state/external_force.hpp"

namespace multipanda {

// The arm's settings declare its hand with rounded figures: the difference from the arm's model.
struct MassExcess {
  double mass = 0;                   // [kg]
  Vector3 moment = Vector3::Zero();  // mass times center, in F [kg m]
};

// Contact detection of the arm: external torques and the wrench at K from the momentum observer
// (core/state/external_force.hpp) with the arm's own model. The estimate of real arms adds two first-order
// stages and the hand as declared in their settings. For each joint and axis of K (x y z roll pitch yaw),
// with absolute values:
//
//   above lower: contact;  above upper: collision, which stops a moving arm
//
// While the arm accelerates, the thresholds for acceleration apply, otherwise the nominal ones. The arm
// accelerates if the desired motion does or, without one, if a measured joint velocity changes by more than
// kAccelerating after a filter of kRateFilter. These values are ours; Franka documents none. Near
// singular poses the wrench cannot be computed from joint torques: it is zero there, as in Franka's
// documentation. "Near" is 1/tr((J J^T)^-1) < kSingular, J at K: that is 1/6 to 1 of the smallest eigenvalue
// of J J^T.
class ContactMonitor {
 public:
  static constexpr double kAccelerating = 0.5;  // [rad/s^2]
  static constexpr double kRateFilter = 60;     // [rad/s]
  static constexpr double kSingular = 5e-4;

  static constexpr double kRealFirst = 12, kRealSecond = 6;  // stages of real arms [Hz]

  // `as_real`: the estimate of real arms.
  explicit ContactMonitor(std::size_t joint_count, bool as_real = false, const MassExcess& hand = {});

  // Resets to no contact, at rest.
  void reset();

  // Takes the measurement of a period. terms: at its q, dq, with its frames and loads. desired_ddq: of the
  // running motion (n x 1), empty without one. Loop thread, no allocation.
  void update(ModelTerms& terms, const ArmState& state, const JointVector& desired_ddq, double dt,
              const SetCollisionThresholds& thresholds);

  const JointVector& tau_ext_hat() const { return estimate_.tau_ext_hat; }  // [N m] (n x 1)
  const Wrench& F_K_W() const { return F_K_W_; }  // by the arm on its environment, world axes
  const Wrench& F_K_K() const { return F_K_K_; }  // axes of K
  const JointVector& joint_contact() const { return joint_contact_; }  // 0 or 1 (n x 1)
  const Vector6& cartesian_contact() const { return cartesian_contact_; }
  bool accelerating() const { return accelerating_; }

  // The largest excess over an upper threshold, joint_reflex before cartesian_reflex; or none.
  ReflexDetail collision() const { return joint_collision_ ? joint_collision_ : cartesian_collision_; }
  const ReflexDetail& joint_collision() const { return joint_collision_; }
  const ReflexDetail& cartesian_collision() const { return cartesian_collision_; }
  // Joints and axes beyond it, 0 or 1.
  const JointVector& joint_levels() const { return joint_above_; }
  const Vector6& cartesian_levels() const { return cartesian_above_; }

 private:
  void sense(ModelTerms& terms, const ArmState& state, double dt);
  JointVector excess_weight(ModelTerms& terms, const Jacobian& J_V_WK) const;

  bool as_real_;
  MassExcess hand_;
  ExternalForceObserver observer_;
  JointVector second_stage_;
  ArmState estimate_;  // input and output of the observer
  Wrench F_K_W_, F_K_K_;
  JointVector dq_slow_;
  bool begun_ = false, accelerating_ = false;
  JointVector joint_contact_, joint_above_;
  Vector6 cartesian_contact_ = Vector6::Zero(), cartesian_above_ = Vector6::Zero();
  ReflexDetail joint_collision_, cartesian_collision_;
};

}  // namespace multipanda
