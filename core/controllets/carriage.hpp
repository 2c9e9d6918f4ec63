#pragma once

#include "core/controllets/contact_bounds.hpp"
#include "core/model/arm_model.hpp"

// What a prismatic joint moves, a carriage, may meet a person as a hand does: the bounds for contact hold for
// the joint's own force as well. An arm without prismatic joints has no such share. For the loop's thread,
// without allocation.
namespace multipanda {

// The largest share that the pulls `pull` of prismatic joints (n x 1) take of what bound_pull() allows along
// their axes: above 1, too much. `damping` is D dq (n x 1), which a pull may overcome on its way. A carriage
// that stands, for whatever reason, is then pushed with spring_force at most.
double carriage_share(const ContactBounds& bounds, const ArmModel& model, const JointVector& pull,
                      const JointVector& damping, const JointVector& dq);

// The same for a spring, as strain_of().
double carriage_strain(const ContactBounds& bounds, const ArmModel& model, const JointVector& spring);

}  // namespace multipanda
