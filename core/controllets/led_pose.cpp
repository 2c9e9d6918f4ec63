#include "core/controllets/led_pose.hpp"

namespace multipanda {

Matrix3 leading_rotation(LeadingAxes axes, const ArmModel& leader, const ArmModel& follower) {
  if (axes == LeadingAxes::world) return Matrix3::Identity();
  return follower.X_WB().rotation * leader.X_WB().rotation.transpose();
}

void LedPose::start(const OwnedArm& leader, const Pose& X) {
  X_ = X;
  skip(leader);
}

void LedPose::skip(const OwnedArm& leader) {
  X_leader_ = leader.terms->X_WE();
  X_FE_leader_ = leader.state->frames.X_FE;
  V_.setZero();
}

void LedPose::advance(const OwnedArm& leader, const Matrix3& R_map, double scale) {
  const Pose& X_FE = leader.state->frames.X_FE;
  const bool same_hand = X_FE.position == X_FE_leader_.position && X_FE.rotation == X_FE_leader_.rotation;
  if (!same_hand) X_leader_ = X_leader_ * X_FE_leader_.inverse() * X_FE;  // the new one, where it was
  const Pose X_before = X_leader_;
  skip(leader);
  X_.position += scale * (R_map * (X_leader_.position - X_before.position));
  const Matrix3 turned = R_map * X_leader_.rotation * X_before.rotation.transpose() * R_map.transpose();
  // Normalized, since millions of products would accumulate rounding.
  X_.rotation = Quaternion(turned * X_.rotation).normalized().toRotationMatrix();
  const Twist& V = leader.terms->V_WE();
  V_.head<3>() = scale * (R_map * V.linear());
  V_.tail<3>() = R_map * V.angular();
}

void LedPose::carry(const Pose& X) {
  const Vector3 p = X_.rotation * X.position;
  V_.head<3>() += Vector3(V_.tail<3>()).cross(p);
  X_ = X_ * X;
}

}  // namespace multipanda
