#pragma once

#include "core/controllets/controllet.hpp"

// The pose to which a leader's hand leads another arm's. Loop thread, no allocation.
namespace multipanda {

// The axes of both arms that correspond: the hands move along the same ones.
enum class LeadingAxes : std::uint8_t {
  base,  // of each arm's base
  world
};
Matrix3 leading_rotation(LeadingAxes axes, const ArmModel& leader, const ArmModel& follower);  // R_map

// Adds up the motion of the leader's hand since it began, mapped by R_map and scaled by s:
//   dp = s R_map dp_l,   dR = R_map dR_l R_map^T
// What it led to so far stays, so that the pose is continuous when s or the leader's end effector changes.
class LedPose {
 public:
  void start(const OwnedArm& leader, const Pose& X);
  void place(const Pose& X) { X_ = X; }  // leads on from X
  void advance(const OwnedArm& leader, const Matrix3& R_map, double scale);
  // The same without adding: the leader moves on its own.
  void skip(const OwnedArm& leader);
  void stand() { V_.setZero(); }  // it no longer counts as moving
  // The end effector that is led was redefined, X away from the old one.
  void carry(const Pose& X);

  const Pose& X() const { return X_; }
  const Vector6& V() const { return V_; }  // world axes; zero after skip()

 private:
  Pose X_, X_leader_, X_FE_leader_;
  Vector6 V_ = Vector6::Zero();
};

}  // namespace multipanda
