#include "tests/teleoperation/operator.hpp"

#include <algorithm>

#include "scene/build.hpp"

namespace multipanda::teleoperation {

Operator::Operator(const SceneArm& arm, std::size_t index) : index_(index), terms_(build_arm_model(arm)) {
  const ArmConfig config = arm_config(arm);
  terms_.set_config(config.frames, config.tool, config.load);
  q_ = dq_ = joint_constant(terms_.joint_count(), 0);
  terms_.update(arm.q_start, dq_);
  X_start_ = terms_.X_WE();
}

void Operator::apply(MujocoBackend& backend, const Pose& X, const Vector6& V) {
  World& world = backend.world();
  world.joints(index_, q_, dq_);
  terms_.update(q_, dq_);
  const Pose& X_WE = terms_.X_WE();
  const Vector6 x = pose_error(X, X_WE), v = V - terms_.V_WE().vector;
  F_ << kStiffness * x.head<3>() + kDamping * v.head<3>(),
      kTurnStiffness * x.tail<3>() + kTurnDamping * v.tail<3>();
  grip_ = std::min(1.0, grip_ + 0.001 / 0.3);
  F_ *= grip_;
  // MuJoCo takes wrenches at the center of mass of a body.
  const int body = world.arm(index_).last_link;
  const Eigen::Map<const Vector3> p(world.data()->xipos + 3 * body);
  const Wrench at_center = shifted({F_}, X_WE.position - p);
  std::copy_n(at_center.vector.data(), 6, world.data()->xfrc_applied + 6 * body);
}

void Operator::let_go(MujocoBackend& backend) {
  backend.world().joints(index_, q_, dq_);
  F_.setZero();
  grip_ = 0;
  std::fill_n(backend.world().data()->xfrc_applied + 6 * backend.world().arm(index_).last_link, 6, 0.0);
}

double Operator::work(const MujocoBackend& backend) {
  JointVector q = q_, dq = dq_;
  backend.world().joints(index_, q, dq);
  terms_.update(JointVector(0.5 * (q + q_)), dq);
  return F_.dot(Vector6(terms_.J_V_WE() * (q - q_)));
}

}  // namespace multipanda::teleoperation
