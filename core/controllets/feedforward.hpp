#pragma once

#include "core/model/arm_model.hpp"

// How fast the acceleration of a set-point is fed forward. Loop thread, no allocation.
namespace multipanda {

// The share of `change`, of the torque that an acceleration feeds forward (n x 1), which a tick of dt [s] may
// make: a quarter of the arm's torque rate at most, along its way. A set-point that catches up with a stream,
// or goals that replace each other, accelerate within milliseconds. Joints that turn about nearly one axis
// would then need more than the whole rate; cut joint by joint, their torques no longer balance and drive the
// light mode between them, and while they are cut, its damping comes too late.
double rate_share(const JointVector& change, const ArmModel& model, double dt);

// Moves what is fed forward to what is asked.
template <typename Vector>
void feed(const Vector& asked, double share, Vector& fed) {
  if (share < 1) {
    fed += share * Vector(asked - fed);
  } else {
    fed = asked;
  }
}

}  // namespace multipanda
