#pragma once

#include <limits>

#include "core/model/arm_model.hpp"
#include "core/types/spatial.hpp"

// Bounds for an arm beside a person: on the speed of its hand and on the pull of its set-point. They are not
// a certified safety function. Loop thread, no allocation.
namespace multipanda {

struct ContactBounds {
  double hand_speed = 0.25;   // of set-points [m/s]: ISO 10218-1:2011, 5.6.2, reduced speed
  double spring_force = 60;   // of the pull at a hand [N]: below the 140 N that ISO/TS 15066 allows a hand
  double spring_moment = 15;  // [N m]

  static constexpr ContactBounds lifted() {
    constexpr double kNone = std::numeric_limits<double>::infinity();
    return {kNone, kNone, kNone};
  }
};

ContactBounds tighter(const ContactBounds& a, const ContactBounds& b);

// The bounded pull: the part of a law that pulls a hand to its moving set-point,
//   P = K x~ + D V_d + Lambda A_d
// Its moment acts with P min(1, (F_max + max(0, n^T D V)) / |P|), n = P / |P|. The damping -D V is kept
// whole, so that it can only take energy; the pull may overcome it on the way along n. So
// n^T (P' - D V) <= F_max: a hand at rest is pushed with F_max at most.
// Of its force, F_max falls with the speed v along n that the hand has already, to zero at one and a half
// times hand_speed, but by no more than 300 N per m/s; above hand_speed the pull overcomes no more damping
// than there. So a hand that was held back and is let go comes after its set-point not much faster than the
// set-point may move, or than F_max / 300 N s/m.
struct BoundedPull {
  double force_share = 0, moment_share = 0;  // |P| over what is allowed; above 1: bounded

  Vector6 remaining(const Vector6& pull) const;
  // Factor on a pull that must keep its direction in joint space.
  double factor() const;
};
// `damping` is D V at the same point and in the same axes as the pull, `v` the velocity of that point.
BoundedPull bound_pull(const ContactBounds& bounds, const Vector6& pull, const Vector6& damping,
                       const Vector3& v);

// The bound on the force for a hand that already moves at `speed` along it [m/s], without damping [N].
double force_at_speed(const ContactBounds& bounds, double speed);

// Strain: the pull of springs between set-point and arm (6 x 1) [N, N m], over what the bounds allow; over
// the usual bounds where a scene lifts them.
double strain_of(const Vector6& spring, const ContactBounds& bounds);

// The largest c in [0, 1] with |base + c extra| <= limit, for |base| <= limit.
double largest_share(const Vector3& base, const Vector3& extra, double limit);

// The largest component perpendicular to `across` for which the sum respects the limit.
double left_beside(const Vector3& across, double limit);

// A carriage, which a prismatic joint moves, may touch a person as a hand does: the bounds for contact hold
// for the joint's own force as well. Zero for an arm without prismatic joints. For the loop's thread,
// without allocation.
//
// The largest share that the pulls `pull` of prismatic joints (n x 1) take of what bound_pull() allows along
// their axes: above 1, too much. `damping` is D dq (n x 1), which a pull may overcome on its way. A carriage
// at rest is then pushed with spring_force at most.
double carriage_share(const ContactBounds& bounds, const ArmModel& model, const JointVector& pull,
                      const JointVector& damping, const JointVector& dq);

// The same for a spring, as strain_of().
double carriage_strain(const ContactBounds& bounds, const ArmModel& model, const JointVector& spring);

}  // namespace multipanda
