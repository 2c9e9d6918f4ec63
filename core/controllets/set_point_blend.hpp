#pragma once

#include "core/controllets/cartesian_law.hpp"

namespace multipanda {

// Moves an arm from its current set-point to the set-point of a rule, without a step. The difference is kept
// while the rule's set-point is at rest, so that the arm does not move by itself. It is removed along a
// quintic once that set-point moves. It moves the hand in addition to the rule, so with bounds for contact it
// has a share of the hand's speed, and the rule the remainder. Loop thread.
//   p_d = p_rule + s p_dev,  R_d = exp(s r_dev) R_rule,  s from 1 to 0
class SetPointBlend {
 public:
  static constexpr double kSpeed = 0.25, kAngularSpeed = 0.5;  // peaks [m/s], [rad/s]
  static constexpr double kShortest = 1.0;                     // [s]
  static constexpr double kShare = 0.25;                       // of what a hand may reach beside people

  // Starts at X_now and captures its difference from the rule. `hand_speed`: what the hand may reach [m/s].
  void capture(const Pose& X_now, const Pose& X_rule, double hand_speed);
  // Whether the difference has vanished, or there was none.
  bool over() const { return t_ >= duration_ || (p_dev_.norm() < 1e-6 && r_dev_.norm() < 1e-6); }
  // Largest contribution to the speed of the hand until it ends [m/s].
  double top_speed() const { return over() ? 0 : rest_to_rest_speed(p_dev_.norm(), duration_); }
  // The blended set-point of this cycle; `rule` counts as moving if its velocity is not zero.
  CartesianTarget advance(const CartesianTarget& rule, double dt);

 private:
  Vector3 p_dev_ = Vector3::Zero(), r_dev_ = Vector3::Zero();
  double duration_ = kShortest, t_ = 0;
  bool released_ = true;
};

// Set-points of a hand whose end effector was redefined, from a rule for the old one: E_new = E_old X. X is
// kept while the rule is at rest, so that the arm does not move by itself, and fades once it moves; the new
// end effector then follows the rule. Loop thread.
//   X_W_d = X_rule {exp(s r), s p},  X = {exp(r), p},  s from 1 to 0
class SetPointShift {
 public:
  static constexpr double kShare = 0.125;  // of what a hand may reach beside people

  void clear() { *this = {}; }
  void add(const Pose& X, double hand_speed);
  bool over() const { return t_ >= duration_; }
  // Largest contribution to the speed of a hand whose rule does not turn [m/s], and distance of the hand from
  // the rule's pose, about which it turns [m].
  double top_speed() const { return over() ? 0 : rest_to_rest_speed(p_.norm(), duration_); }
  double lever() const { return over() ? 0 : p_.norm(); }
  CartesianTarget advance(const CartesianTarget& rule, double dt);

 private:
  Vector3 p_ = Vector3::Zero(), r_ = Vector3::Zero();
  double duration_ = 0, t_ = 0;
  bool released_ = true;
};

}  // namespace multipanda
