#pragma once

#include "core/controllets/cartesian_law.hpp"

namespace multipanda {

// Leads an arm from the set-point it has to the one a rule gives it, without a step. The difference between
// the two is kept while the rule's set-point rests, so that nothing moves unasked, and taken away along a
// quintic once that set-point moves for the first time. Loop thread.
//   p_d = p_rule + s p_dev,  R_d = exp(s r_dev) R_rule,  s from 1 to 0
class SetPointBlend {
 public:
  static constexpr double kSpeed = 0.25, kAngularSpeed = 0.5;  // peaks [m/s], [rad/s]
  static constexpr double kShortest = 1.0;                     // [s]

  // From now on: starts at X_now, whatever the rule says.
  void capture(const Pose& X_now, const Pose& X_rule);
  // The blended set-point of this cycle; `rule` is taken as moving where its velocity is not zero.
  CartesianTarget advance(const CartesianTarget& rule, double dt);

 private:
  Vector3 p_dev_ = Vector3::Zero(), r_dev_ = Vector3::Zero();
  double duration_ = kShortest, t_ = 0;
  bool released_ = true;
};

}  // namespace multipanda
