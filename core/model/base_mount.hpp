#pragma once

#include <cstddef>
#include <string>

#include "core/model/arm_model.hpp"
#include "core/types/arm_set.hpp"
#include "core/types/spatial.hpp"

namespace multipanda {

// The base of a carried arm stands on a link of another arm, its carrier: a torso that two arms share belongs
// to the chain of the carrier, and moves the base of the carried arm.
struct BaseMount {
  ArmIndex carrier = 0;
  std::size_t joint = 0;  // the link behind this joint of the carrier, 0 to n-1
  Pose X_JB;  // base B of the carried arm in that joint's frame, ModelTerms::X_WJ(joint) of the carrier
};

// Why the joints of a carrier up to `joint` would turn the carried arm against gravity, as text; empty: they
// do not. Revolute axes are to be vertical and prismatic ones level, each with an error of at most kUpright
// in every pose: an arm compensates gravity for the direction in which it was mounted, and the carrier
// compensates its own weight only. An arm of 18 kg then leaves at most about 4 N m, or 4 N, uncompensated.
// Not for the loop.
inline constexpr double kUpright = 0.02;  // sine of the angle: 1.1 degrees
std::string turns_against_gravity(const ArmModel& carrier, std::size_t joint);

}  // namespace multipanda
