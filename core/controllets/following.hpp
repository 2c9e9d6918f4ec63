#pragma once

#include "core/controllets/cartesian_law.hpp"
#include "core/controllets/following_motion.hpp"
#include "core/controllets/led_pose.hpp"

// Parts that the laws with a leader share. Loop thread, no allocation.
namespace multipanda {

// What begins when a follower starts or its clutch closes.
enum class Alignment : std::uint8_t {
  keep,  // the difference between leader and follower stays
  match  // the follower goes where the leader is, within the speed of its hand
};

ParameterSpec clutch_parameter();
ParameterSpec alignment_parameter();
ParameterSpec leading_axes_parameter();
ParameterSpec leading_scale_parameter();

// A leader whose states fail to arrive leads nowhere: its last velocity no longer counts after 3 periods, so
// that the set-point brakes. The safety stage holds the follower soon after.
inline constexpr double kLeaderFalters = 0.003;  // [s]

// Detects positions that jump: the leader's joints turned farther since its last packet than they can. It is
// then not known where the leader is, so the law faults and its arms are held.
class LeaderWatch {
 public:
  void start(const OwnedArm& leader);
  bool jumped(const OwnedArm& leader);  // since the last call; also if a position is not a number

 private:
  JointVector q_;
  RobotTime t_;
};

// The set-point of a hand that follows a pose.
class FollowingPose {
 public:
  void start(const Pose& X);
  // Towards the target X with velocity V, world axes. `bounds` limit the hand's speed.
  void advance(const Pose& X, const Vector6& V, const ContactBounds& bounds, double dt);
  // Brakes to rest.
  void brake(const ContactBounds& bounds, double dt);
  // What pulled the hand in this tick: the set-point waits for it from the next one on.
  void resist(const Vector6& pull, double force_share, double moment_share, double dt);
  void carry(const Pose& X);  // the end effector was redefined, X away from the old one

  const Pose& X() const { return X_d_; }
  CartesianTarget target() const;

 private:
  void move(const JointVector& velocity, const JointVector& difference, const ContactBounds& bounds,
            double dt);

  Pose X_d_;
  FollowingMotion motion_;
  Resistance force_, moment_;
};

}  // namespace multipanda
