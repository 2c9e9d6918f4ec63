#include "core/controllets/following.hpp"

#include <algorithm>

namespace multipanda {
namespace {

// Limits of set-points. A jerk of kPole times the acceleration lets them brake without passing their target.
constexpr double kSpeed = 0.5, kAngularSpeed = 1.0;            // [m/s], [rad/s]
constexpr double kAcceleration = 3, kAngularAcceleration = 6;  // [m/s^2], [rad/s^2]
constexpr double kJerk = 250, kAngularJerk = 500;              // [m/s^3], [rad/s^3]

}  // namespace

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
          .doc = "Way of the follower's hand for a way of the leader's; rotations are not scaled."};
}

void LeaderWatch::start(const OwnedArm& leader) {
  q_ = leader.q();
  t_ = leader.state->t_robot;
}

bool LeaderWatch::jumped(const OwnedArm& leader) {
  constexpr double kFaster = 1.5, kNoise = 0.005;  // than the joints' limits; [rad]
  const double dt = std::max(0.0, seconds(leader.state->t_robot - t_));
  const auto possible = kFaster * dt * leader.model().limits().dq_max.array() + kNoise;
  const bool jumped = !((leader.q() - q_).array().abs() <= possible).all();
  start(leader);
  return jumped;
}

void FollowingPose::start(const Pose& X) {
  X_d_ = X;
  motion_.start(6);
  force_.start(3);
  moment_.start(3);
}

void FollowingPose::advance(const Pose& X, const Vector6& V, const ContactBounds& bounds, double dt) {
  move(V, pose_error(X, X_d_), bounds, dt);
}

void FollowingPose::brake(const ContactBounds& bounds, double dt) {
  move(JointVector::Zero(6), dt * motion_.velocity(), bounds, dt);  // to where it would be
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
}

CartesianTarget FollowingPose::target() const {
  CartesianTarget target{X_d_, {}, {}};
  target.V_d.vector = motion_.velocity();
  target.A_d.vector = motion_.acceleration();
  return target;
}

}  // namespace multipanda
