#pragma once

#include "core/controllets/controllet.hpp"

namespace multipanda {

// Bounds the torque of a feature's potential, so that no feature throws an arm near an obstacle or a limit
// when it is switched on, changed, or released. `tau` (n x 1) is scaled:
//   - It pulls a held hand with at most spring_force and spring_moment, less the pulls along it of earlier
//     features, in arm.tau, and less where the arm is so light that it would reach the speeds below within
//     5 ms. A carriage is pulled with at most spring_force likewise.
//   - Up to the same amount is added against what controllet and other features press: otherwise a law could
//     press an arm into an obstacle.
//   - It takes at least 0.1 s to reach the bounds: a step would meet the limit of torque rates, and still act
//     when it should have ended.
//   - What a changed parameter takes from it goes in 0.2 s, and the slower, the faster the arm already comes
//     back: a range that falls would end it at once, and one that rises again may draw elsewhere: what that
//     takes goes likewise. So does what a law that pressed no longer presses, while tau brakes a hand: tau
//     would fall with the law's damping, and leave the arm none.
//   - By itself tau moves the arm along M^-1 tau; the part of dq along that, in the metric of M, is
//     beta M^-1 tau. tau falls with beta > 0, to nothing where beta M^-1 tau has the hand at 0.9 hand_speed
//     or the joints at 1 rad/s, but no steeper than damping of 200 1/s times the inertia that tau moves,
//     since it acts some periods late; up to twice as steep while the hand is nearly that fast on any other
//     way.
// So it gives no more energy than the potential loses, and takes none of the damping that a feature adds to
// it. Unchanged where a scene lifts the bounds for contact. Loop thread, no allocation.
class BoundedDrive {
 public:
  JointVector limit(const ControlContext& context, const OwnedArm& arm, const JointVector& tau);
  // `factor`: of M, lower half. `law`: the torque of the controllet (n x 1); nullptr: unknown.
  JointVector limit(const ControlContext& context, const OwnedArm& arm, const JointVector& tau,
                    const JointMatrix& factor, const JointVector* law);
  bool keeps() const { return last_.size() > 0 && !last_.isZero(0); }

 private:
  double share_ = 0;  // share of the bounds that it pulls with; a start needs no reset: features fade in
  JointVector last_;  // what tau was scaled to in the last tick, at rest (n x 1)
  double time_s_ = 0;
  std::uint32_t version_ = 0;
  bool changed_ = false;  // and has not caught up
};

// The pace, up to 1, at which a feature lets go of an arm that it pressed, since the springs of the law pull
// it back: the slower, the faster it already moves. The speeds are those at which a set-point returns after a
// raised stiffness (core/controllets/raised_spring.hpp).
double release_pace(const OwnedArm& arm, const ContactBounds& contact);

}  // namespace multipanda
