#include "core/controllets/following.hpp"

#include <algorithm>

namespace multipanda {
namespace {

// Limits of set-points. A jerk of kPole times the acceleration lets them brake without passing their target.
constexpr double kSpeed = 0.5, kAngularSpeed = 1.0;            // [m/s], [rad/s]
constexpr double kAcceleration = 3, kAngularAcceleration = 6;  // [m/s^2], [rad/s^2]
constexpr double kJerk = 250, kAngularJerk = 500;              // [m/s^3], [rad/s^3]

}  // namespace

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
  if (!same_hand)
    X_leader_ = X_leader_ * X_FE_leader_.inverse() * X_FE;  // of the new end effector, at the
                                                            // same place
  const Pose X_before = X_leader_;
  skip(leader);
  X_.position += scale * (R_map * (X_leader_.position - X_before.position));
  const Matrix3 turned = R_map * X_leader_.rotation * X_before.rotation.transpose() * R_map.transpose();
  // Normalized, because rounding accumulates over millions of products.
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

ParameterSpec clutch_parameter() {
  return switch_parameter("clutch", true,
                          "Closed: the follower follows. Open: it brakes and stays; closing aligns again.");
}

ParameterSpec alignment_parameter() {
  return choice_parameter("alignment", {"keep", "match"},
                          "When following begins: keep the difference between both arms, or go where the "
                          "leader is, within the speed of the hand.");
}

ParameterSpec leading_axes_parameter() {
  return choice_parameter("axes", {"base", "world"},
                          "Axes in which both arms move alike: those of their bases, or of the world.");
}

ParameterSpec leading_scale_parameter() {
  return {.name = "scale",
          .initial = {1},
          .min = 0.05,
          .max = 3,
          .doc = "Motion of the follower's hand per motion of the leader's; rotations are not scaled."};
}

void JumpDetector::start(const OwnedArm& arm) {
  q_ = arm.q();
  t_ = arm.state->t_robot;
}

bool JumpDetector::jumped(const OwnedArm& arm) {
  constexpr double kFaster = 1.5, kNoise = 0.005;  // than the joints' limits; [rad]
  constexpr double kLongest = 0.03;  // an arm silent for longer is lost, and its clock may jump [s]
  const double dt = std::clamp(seconds(arm.state->t_robot - t_), 0.0, kLongest);
  const auto possible = kFaster * dt * arm.model().limits().dq_max.array() + kNoise;
  const bool jumped = !((arm.q() - q_).array().abs() <= possible).all();
  start(arm);
  return jumped;
}

double largest_lag(const ContactBounds& bounds) {
  constexpr double kTime = 0.5;  // [s]
  return kTime * std::min(kSpeed, bounds.hand_speed);
}

bool Clutch::turn(bool asked, bool left_behind, double strain, double dt) {
  constexpr double kBlocked = 0.8, kFor_s = 0.3;
  if (!asked) {
    start();
    return false;
  }
  arrived_ = arrived_ || !left_behind;
  blocked_s_ = strain > kBlocked && !arrived_ ? blocked_s_ + dt : 0;
  if ((arrived_ && left_behind) || blocked_s_ > kFor_s || strain > kLargestStrain) slipped_ = true;
  return !slipped_;
}

bool FollowingPose::left_behind(const Pose& X, const ContactBounds& bounds) const {
  const Vector6 lag = pose_error(X, X_d_);
  return lag.head<3>().norm() > largest_lag(bounds) || lag.tail<3>().norm() > kLargestLagAngle;
}

double FollowingPose::strain(const Pose& X_WE, const ImpedanceGains& gains) const {
  return strain_of(spring_wrench(gains.stiffness(X_d_.rotation), pose_error(X_d_, X_WE)), gains.contact);
}

void FollowingPose::start(const Pose& X) {
  X_d_ = X;
  yields_ = false;
  motion_.start(6);
  force_.start(3);
  moment_.start(3);
}

void FollowingPose::advance(const Pose& X, const Vector6& V, const ContactBounds& bounds, double dt) {
  yields_ = false;
  move(V, pose_error(X, X_d_), bounds, dt);
}

void FollowingPose::brake(const Pose& X_WE, double strain, const ContactBounds& bounds, double dt) {
  if (!yields_ && motion_.rests() && strain > kYieldsFrom) {
    yields_ = true;
    X_yields_ = X_WE;
  }
  JointVector way = dt * motion_.velocity();  // to the predicted position
  if (yields_) way = pose_error(X_yields_, X_d_);
  move(JointVector::Zero(6), way, bounds, dt);
}

void FollowingPose::move(const JointVector& velocity, const JointVector& difference,
                         const ContactBounds& bounds, double dt) {
  const FollowingLimits linear{.first = 0,
                               .count = 3,
                               .speed = std::min(kSpeed, bounds.hand_speed),
                               .acceleration = kAcceleration,
                               .jerk = kJerk},
      angular{.first = 3,
              .count = 3,
              .speed = kAngularSpeed,
              .acceleration = kAngularAcceleration,
              .jerk = kAngularJerk};
  motion_.advance(motion_.desired(difference, velocity, linear, force_, dt), linear, dt);
  motion_.advance(motion_.desired(difference, velocity, angular, moment_, dt), angular, dt);
  const JointVector& v = motion_.velocity();
  X_d_.position += dt * v.head<3>();
  X_d_.rotation =
      Quaternion(exp_rotation(dt * v.segment<3>(3)) * X_d_.rotation).normalized().toRotationMatrix();
}

void FollowingPose::resist(const Vector6& pull, double force_share, double moment_share, double dt) {
  force_.update(pull.head<3>(), force_share, dt);
  moment_.update(pull.tail<3>(), moment_share, dt);
}

void FollowingPose::carry(const Pose& X) {
  motion_.carry(X_d_.rotation * X.position);
  X_d_ = X_d_ * X;
  X_yields_ = X_yields_ * X;
}

CartesianTarget FollowingPose::target() const {
  CartesianTarget target{X_d_, {}, {}};
  target.V_d.vector = motion_.velocity();
  target.A_d.vector = motion_.acceleration();
  return target;
}

}  // namespace multipanda
