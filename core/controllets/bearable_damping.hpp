#pragma once

#include <span>

#include "core/controllets/parameters.hpp"
#include "core/model/arm_model.hpp"

// How much damping a joint bears in a loop that is sampled. A torque -D dq that is one period old when it
// acts on the inertia I is stable for D T / I < 1: v_next = v - (D T / I) v_before. Motors that lag and
// further delay need a margin; half of it is what torque tracking of 50 Hz with a delay of 1 ms bears (0.54,
// from the phase of the loop).
namespace multipanda {

inline constexpr double kBearableShare = 0.5;  // of I / T

// kBearableShare I / T per joint (n x 1) [N m s/rad]. I is the least inertia that the joint has in any pose:
// links, hand, tool and, as far as the model states it, motor.
JointVector bearable_damping(const ArmModel& model);

// Lowers the upper bounds of parameter i, a damping with one number per joint, to it.
void bound_damping(const ArmModel& model, std::size_t i, ParameterSet& parameters);

}  // namespace multipanda
