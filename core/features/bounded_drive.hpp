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

 private:
  double share_ = 0;  // share of the bounds that it pulls with; a start needs no reset: features fade in
};

}  // namespace multipanda
