#pragma once

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/model/model_terms.hpp"
#include "scene/scene.hpp"

namespace multipanda::teleoperation {

// The hand of a person who leads an arm: a spring and damper from the arm's hand to where the person's would
// be, F = K x~ + D V~. Works on the plant, at its true joints.
class Operator {
 public:
  static constexpr double kStiffness = 400, kDamping = 40;          // [N/m], [N s/m]
  static constexpr double kTurnStiffness = 10, kTurnDamping = 0.2;  // [N m/rad], [N m s/rad]

  Operator(const SceneArm& arm, std::size_t index);
  const Pose& start() const { return X_start_; }  // the arm's hand at its start
  // Before a step. A hand that grips takes 0.3 s for it.
  void apply(MujocoBackend& backend, const Pose& X, const Vector6& V = Vector6::Zero());
  void let_go(MujocoBackend& backend);
  const Vector6& wrench() const { return F_; }  // on the arm's hand, world axes [N, N m]
  // After a step: its work on the arm, since the joints of the last apply() [J].
  double work(const MujocoBackend& backend);

 private:
  std::size_t index_;
  ModelTerms terms_;
  Pose X_start_;
  JointVector q_, dq_;
  Vector6 F_ = Vector6::Zero();
  double grip_ = 1;
};

}  // namespace multipanda::teleoperation
