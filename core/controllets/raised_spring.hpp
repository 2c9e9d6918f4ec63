#pragma once

#include <optional>

#include "core/controllets/cartesian_law.hpp"
#include "core/controllets/following_motion.hpp"
#include "core/controllets/joint_law.hpp"

// A stiffness that rises while its spring is stretched would give it energy, and the spring would throw the
// arm at its set-point. Instead the spring sees another set-point from then on, so near that its force stays
// as it is: K' x~' = K x~, which only takes energy. That set-point then returns to that of the rule, as a
// motion of its own, within what the rule leaves of the hand's speed; it waits for an arm that cannot follow.
// Meanwhile no acceleration is fed forward: near a singular pose its inertia would throw the hand.
// Without a rise nothing changes, bit for bit. Loop thread, no allocation.
namespace multipanda {

// Offset from the rule's set-point to the one that the spring sees, in n coordinates.
class ReturningOffset {
 public:
  // Shares of the speed that a hand may reach beside people: of the return, and of return and rule together.
  // A hand that damping pulls after both exceeds their sum, two hands by up to a quarter.
  static constexpr double kShare = 0.4, kTogether = 0.8;
  static constexpr double kTurning = 0.5;  // [rad/s]
  // Hands return with half of the acceleration of goals, joints with all of it [m/s^2], [rad/s^2].
  static constexpr double kSlides = 2, kTurns = 4, kJoints = 5;

  void start(Eigen::Index coordinates, Resistance::Waits waits = Resistance::Waits::along);
  bool none() const { return none_; }
  void shift(const JointVector& by);
  void go(const JointVector& velocity);  // sets its velocity
  // One tick of the return, with at most this speed and acceleration. `behind`: the velocity that the rule
  // is left ahead with, in the offset's coordinates.
  void advance(const JointVector& behind, double speed, double acceleration, double dt);
  // The pull of this tick, and its share of what is allowed: from the next tick on it waits.
  void resist(const JointVector& pull, double share, double dt);

  const JointVector& value() const { return value_; }
  const JointVector& velocity() const { return motion_.velocity(); }
  const JointVector& acceleration() const { return motion_.acceleration(); }

 private:
  JointVector value_;
  FollowingMotion motion_;
  Resistance resistance_;
  bool none_ = true;
};

// From the end effector to the farthest of flange and tool [m].
double farthest_point(ModelTerms& terms);

// The spring of a frame: a pose, world axes. A new one for each start.
class RaisedSpring {
 public:
  RaisedSpring();
  bool none() const { return position_.none() && rotation_.none() && fed_ >= 1; }

  // The set-point that the spring of a hand sees in this tick. `asked`: gains before soften(), and bounds.
  CartesianTarget follow(const ImpedanceGains& asked, const CartesianTarget& rule, ModelTerms& terms,
                         double dt);
  void resist(const Vector6& pull, double force_share, double moment_share, double dt);
  double pace() const { return none() ? 1 : ReturningOffset::kTogether; }  // of the rule, at most

  // Its parts, for springs of other coordinates.
  // The gains of the last tick, if these have other stiffnesses.
  std::optional<ImpedanceGains> changed(const ImpedanceGains& asked);
  // One tick of the return of a frame that the rule moves with this twist; `lever`: from it to the farthest
  // point of the hand.
  void come_back(const Vector6& V_rule, double hand_speed, double lever, double dt);
  CartesianTarget seen(const CartesianTarget& rule) const;
  // The seen set-point after a change between softened gains, along the axes of the rule.
  void raise(const ImpedanceGains& before, const ImpedanceGains& now, const CartesianTarget& rule,
             const Pose& X, CartesianTarget& seen);
  // The same for coordinates that are a vector; returns the new error.
  Vector6 raise(const ImpedanceGains& before, const ImpedanceGains& now, const Matrix3& R_d,
                const Vector6& error);
  Vector6 offset() const;
  Vector6 velocity() const;
  // Sets another offset where the rule's set-point was moved to the arm.
  void put(const Vector6& offset);

 private:
  ReturningOffset position_, rotation_;  // R_seen = exp(rotation) R_rule
  std::optional<ImpedanceGains> before_;
  double fed_ = 1;  // share of the acceleration that is seen
  Pose X_FE_;
};

// The springs of the joints of an arm. A new one for each start.
class RaisedJoints {
 public:
  // What the springs see in this tick; the arm's springs are softened by its inertia (n x n).
  JointTarget follow(const JointVector& stiffness, const JointTarget& rule, const ContactBounds& contact,
                     OwnedArm& arm, double dt);
  void resist(const JointVector& pull, double share, double dt) { offset_.resist(pull, share, dt); }
  double pace() const { return offset_.none() ? 1 : ReturningOffset::kTogether; }

 private:
  ReturningOffset offset_;
  JointVector before_;  // stiffness in the last tick; none: the first
};

}  // namespace multipanda
