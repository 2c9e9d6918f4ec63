#pragma once

#include "core/controllets/contact_bounds.hpp"
#include "core/model/arm_model.hpp"

// What laws remember from tick to tick, so that neither the acceleration of a set-point nor a change of
// stiffness throws an arm. Loop thread, no allocation.
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

// The energy that a change of stiffness has given to a stretched spring. A set-point is not held back by a
// hand without stiffness, so it may be far ahead when the stiffness returns.
class RaisedSpring {
 public:
  // The energy of the spring [J] at this stretch, with the stiffness of the tick before and of this one.
  void update(double before, double now);
  bool none() const { return !(share_ > 0); }
  // The bounds for contact, within which such a spring draws no hand faster than hand_speed (bound_pull()).
  ContactBounds bounds(const ContactBounds& usual) const;

 private:
  double energy_ = 0, share_ = 0;  // [J], of the spring's whole energy
};

}  // namespace multipanda
