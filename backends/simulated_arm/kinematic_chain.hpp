#pragma once

#include <array>
#include <memory>

#include "core/model/arm_model.hpp"

// Kinematics of one arm from its base to its end effector, without masses, for many evaluations per period. B
// the base, F the flange, E the end effector; all in the axes of B.
namespace multipanda {

class KinematicChain {
 public:
  // Takes the joints' positions and axes from the model. Any number of revolute and prismatic joints.
  explicit KinematicChain(const std::shared_ptr<const ArmModel>& model);

  std::size_t joint_count() const { return joint_count_; }
  void set_end_effector(const Pose& X_FE) { X_TE_ = X_TF_ * X_FE; }

  // X_BE at q (n x 1). No allocation, about 0.1 us.
  Pose X_BE(const JointVector& q) const;
  // The same, and J_V_BE of E's origin: V_BE = J_V_BE dq, linear first (6 x n).
  Pose X_BE(const JointVector& q, Jacobian& J_V_BE) const;

 private:
  std::size_t joint_count_;
  // Frame of joint i, rotated so that z is its axis, in that of joint i - 1 (of B, for the first).
  std::array<Pose, kMaxJoints> X_PT_;
  std::array<bool, kMaxJoints> slides_{};
  Pose X_TF_, X_TE_;  // flange and end effector in the last of these frames
};

}  // namespace multipanda
