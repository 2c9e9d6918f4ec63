#pragma once

#include "backends/arm/arm_error.hpp"
#include "core/cycle/backend.hpp"
#include "core/model/model_terms.hpp"
#include "core/state/external_force.hpp"

namespace multipanda {

// The arm's own sense of touch: external torques and the wrench at K by the momentum observer
// (core/state/external_force.hpp) over the arm's own model, and what follows from them. Per joint and per
// axis of K (x y z roll pitch yaw), on absolute values:
//
//   above lower: contact, as long as it lasts;  above upper: collision, which stops an arm that moves
//
// While the arm accelerates, the thresholds for acceleration hold, otherwise the nominal ones. It accelerates
// where the desired motion does, or, without one, where a measured joint velocity changes by more than
// kAccelerating behind a filter of kRateFilter: own choices, the maker documents none.
//
// Near singular poses no joint torque tells the wrench: it is zero there, as in the maker's documentation.
// "Near" is 1/tr((J J^T)^-1) < kSingular, J at K: that is 1/6 to 1 of the smallest eigenvalue of J J^T.
class ContactMonitor {
 public:
  static constexpr double kAccelerating = 0.5;  // [rad/s^2]
  static constexpr double kRateFilter = 60;     // [rad/s]
  static constexpr double kSingular = 5e-4;

  explicit ContactMonitor(std::size_t joint_count);

  // Nothing touches, at rest.
  void reset();

  // A period's measurement. terms: at its q, dq, with its frames and loads. desired_ddq: of the motion that
  // runs (n x 1), empty without one. Loop thread, no allocation.
  void update(ModelTerms& terms, const ArmState& state, const JointVector& desired_ddq, double dt,
              const SetCollisionThresholds& thresholds);

  const JointVector& tau_ext_hat() const { return estimate_.tau_ext_hat; }  // [N m] (n x 1)
  const Wrench& F_K_W() const { return F_K_W_; }  // by the arm on its environment, world axes
  const Wrench& F_K_K() const { return F_K_K_; }  // axes of K
  const JointVector& joint_contact() const { return joint_contact_; }  // 0 or 1 (n x 1)
  const Vector6& cartesian_contact() const { return cartesian_contact_; }
  bool accelerating() const { return accelerating_; }

  // What is beyond its upper threshold by most: joint_reflex before cartesian_reflex; or nothing.
  ReflexDetail collision() const { return joint_collision_ ? joint_collision_ : cartesian_collision_; }
  const ReflexDetail& joint_collision() const { return joint_collision_; }
  const ReflexDetail& cartesian_collision() const { return cartesian_collision_; }
  // Joints and axes beyond it, 0 or 1.
  const JointVector& joint_levels() const { return joint_above_; }
  const Vector6& cartesian_levels() const { return cartesian_above_; }

 private:
  void sense(ModelTerms& terms, const ArmState& state);

  ExternalForceObserver observer_;
  ArmState estimate_;  // what the observer reads and fills
  Wrench F_K_W_, F_K_K_;
  JointVector dq_slow_;
  bool begun_ = false, accelerating_ = false;
  JointVector joint_contact_, joint_above_;
  Vector6 cartesian_contact_ = Vector6::Zero(), cartesian_above_ = Vector6::Zero();
  ReflexDetail joint_collision_, cartesian_collision_;
};

}  // namespace multipanda
