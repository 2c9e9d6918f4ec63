#pragma once

#include "core/controllets/cartesian_law.hpp"
#include "core/controllets/controllet.hpp"
#include "core/controllets/following_motion.hpp"

// The pose that a leader's hand commands for another arm. Loop thread, no allocation.
namespace multipanda {

// Corresponding axes of both arms: the hands move along the same ones.
enum class LeadingAxes : std::uint8_t {
  base,  // of each arm's base
  world
};
Matrix3 leading_rotation(LeadingAxes axes, const ArmModel& leader, const ArmModel& follower);  // R_map

// Adds up the motion of the leader's hand since it began, mapped by R_map and scaled by s:
//   dp = s R_map dp_l,   dR = R_map dR_l R_map^T
// The result so far stays, so that the pose is continuous when s or the leader's end effector changes.
class LedPose {
 public:
  void start(const OwnedArm& leader, const Pose& X);
  void place(const Pose& X) { X_ = X; }  // continues from X
  void advance(const OwnedArm& leader, const Matrix3& R_map, double scale);
  // The same without accumulation: the leader moves on its own.
  void skip(const OwnedArm& leader);
  void stand() { V_.setZero(); }  // treats it as resting
  // The follower's end effector was redefined, X away from the old one.
  void carry(const Pose& X);

  const Pose& X() const { return X_; }
  const Vector6& V() const { return V_; }  // world axes; zero after skip()

 private:
  Pose X_, X_leader_, X_FE_leader_;
  Vector6 V_ = Vector6::Zero();
};

// Parts shared by laws with a leader. Loop thread, no allocation.

// Alignment when a follower starts or its clutch closes.
enum class Alignment : std::uint8_t {
  keep,  // keeps the difference between leader and follower
  match  // moves the follower to the leader's pose, within the hand's speed
};

ParameterSpec clutch_parameter();
ParameterSpec alignment_parameter();
ParameterSpec leading_axes_parameter();
ParameterSpec leading_scale_parameter();
inline constexpr const char* kSlippedDoc =
    "1: the follower fell too far behind, so its clutch opened; set `clutch` to false and to true again.";

// Without new states of the leader its last velocity no longer counts after 3 periods, so that the set-point
// brakes. The safety stage holds the follower soon after.
inline constexpr double kLeaderFalters = 0.003;  // [s]

// Detects positions that jump: the joints turned farther since the arm's last packet than they can. Where the
// arm is, is then unknown, so the law faults and its arms are held.
class JumpDetector {
 public:
  void start(const OwnedArm& arm);
  bool jumped(const OwnedArm& arm);  // since the last call; also if a position is not a number

 private:
  JointVector q_;
  RobotTime t_;
};

// Largest lag of a set-point. With a larger one it would continue long after its leader has stopped, on a
// path that nobody commanded, and the leader would have to go back as far before the follower does.
inline constexpr double kLargestLagAngle = 0.5;   // of a hand [rad]
double largest_lag(const ContactBounds& bounds);  // of a hand: its path in 0.5 s at its greatest speed [m]

// A strain (strain_of()) at which following ends: 180 N, 45 N m. Only lifted bounds allow that much.
inline constexpr double kLargestStrain = 3;

// The clutch between leader and follower: closed by the parameter `clutch`, until the set-point lags too far,
// or the strain is too large. It then slips, which opens it until the parameter is set to false and to true
// again. An alignment may begin far away: before it has arrived once, it slips if it is blocked.
class Clutch {
 public:
  void start() { *this = {}; }
  bool turn(bool asked, bool left_behind, double strain, double dt);  // returns whether it is closed
  bool slipped() const { return slipped_; }

 private:
  bool arrived_ = false, slipped_ = false;
  double blocked_s_ = 0;
};

// An open clutch does not keep pressing: above this strain a set-point at rest moves to its hand. Below it,
// undeclared loads and friction do not make an arm sag.
inline constexpr double kYieldsFrom = 0.5;

// The set-point of a hand that follows a pose.
class FollowingPose {
 public:
  void start(const Pose& X);
  // Towards the target X with velocity V, world axes. `bounds` limit the hand's speed.
  void advance(const Pose& X, const Vector6& V, const ContactBounds& bounds, double dt);
  // Brakes to rest; then yields to a hand at X_WE whose strain is above kYieldsFrom.
  void brake(const Pose& X_WE, double strain, const ContactBounds& bounds, double dt);
  // Pull on the hand in this tick: from the next tick on the set-point waits for it.
  void resist(const Vector6& pull, double force_share, double moment_share, double dt);
  void carry(const Pose& X);  // the end effector was redefined, X away from the old one

  const Pose& X() const { return X_d_; }
  CartesianTarget target() const;
  bool left_behind(const Pose& X, const ContactBounds& bounds) const;  // by the target X
  double strain(const Pose& X_WE, const ImpedanceGains& gains) const;

 private:
  void move(const JointVector& velocity, const JointVector& difference, const ContactBounds& bounds,
            double dt);

  Pose X_d_;
  FollowingMotion motion_;
  Resistance force_, moment_;
  bool yields_ = false;
  Pose X_yields_;  // final pose of yielding
};

}  // namespace multipanda
