#pragma once

#include <optional>

#include "core/controllets/cartesian_law.hpp"
#include "core/controllets/following_motion.hpp"
#include "core/controllets/joint_law.hpp"

// A stiffness that rises while its spring is stretched would give it energy, and the spring would throw the
// arm at its set-point. Instead the spring sees another set-point from then on, so near that its force stays
// as it is: K' x~' = K x~, which only takes energy. That set-point then returns to that of the rule, as a
// motion of its own, within what the rule leaves of the hand's speed; it waits for an arm that cannot follow.
// Without a rise nothing changes, bit for bit. Loop thread, no allocation.
namespace multipanda {

// What the seen set-point is ahead of the rule's, in n coordinates.
class ReturningOffset {
 public:
  // Of what a hand may reach beside people: its own greatest speed, and that together with the rule's. A hand
  // that damping leads after both passes their sum a little.
  static constexpr double kShare = 0.4, kTogether = 0.8;
  static constexpr double kTurning = 0.5;  // [rad/s]
  // Of its pace, the rule's meanwhile: a hand that lagged behind catches up.
  static constexpr double kRule = 0.96;
  // As goals accelerate [m/s^2], [rad/s^2].
  static constexpr double kSlides = 4, kTurns = 8, kJoints = 5;

  void start(Eigen::Index coordinates, Resistance::Waits waits = Resistance::Waits::along);
  bool none() const { return none_; }
  void shift(const JointVector& by);
  // A tick of the return with at most this speed and acceleration.
  void advance(double speed, double acceleration, double dt);
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
  bool none() const { return position_.none() && rotation_.none(); }

  // A hand: what its spring sees in this tick. `asked`: before soften(); its contact bounds the speed.
  CartesianTarget follow(const ImpedanceGains& asked, const CartesianTarget& rule, ModelTerms& terms,
                         double dt);
  void resist(const Vector6& pull, double force_share, double moment_share, double dt);
  double pace() const { return none() ? 1 : ReturningOffset::kRule; }  // of the rule, at most

  // Its parts, for springs of other coordinates.
  // The gains of the last tick, if these have other stiffnesses.
  std::optional<ImpedanceGains> changed(const ImpedanceGains& asked);
  // A tick of the return of a frame that the rule moves with this twist; a hand has points this far away.
  void come_back(const Vector6& V_rule, double hand_speed, double lever, double dt);
  CartesianTarget seen(const CartesianTarget& rule) const;
  // The seen set-point after a change of gains, both softened, for the error of the one before. R_d: of the
  // rule, along which the axes of both stiffnesses lie.
  void raise(const ImpedanceGains& before, const ImpedanceGains& now, const Matrix3& R_d, const Pose& X,
             CartesianTarget& seen);
  // The same for coordinates that are a vector; returns the new error.
  Vector6 raise(const ImpedanceGains& before, const ImpedanceGains& now, const Matrix3& R_d,
                const Vector6& error);
  Vector6 offset() const;
  Vector6 velocity() const;
  // Another offset, where the rule's set-point was put onto the arm.
  void put(const Vector6& offset);

 private:
  ReturningOffset position_, rotation_;  // R_seen = exp(rotation) R_rule
  std::optional<ImpedanceGains> before_;
  Pose X_FE_;
};

// The springs of the joints of an arm. A new one for each start.
class RaisedJoints {
 public:
  // What the springs see in this tick; the arm's springs are softened by its inertia (n x n).
  JointTarget follow(const JointVector& stiffness, const JointTarget& rule, const ContactBounds& contact,
                     OwnedArm& arm, double dt);
  void resist(const JointVector& pull, double share, double dt) { offset_.resist(pull, share, dt); }
  double pace() const { return offset_.none() ? 1 : ReturningOffset::kRule; }

 private:
  ReturningOffset offset_;
  JointVector before_;  // stiffness in the last tick; none: the first
};

}  // namespace multipanda
