#pragma once

#include "models/robot_description.hpp"

// Friction of a joint as a smooth function of its velocity (Gaz et al., RA-L 2019):
//   tau_f(dq) = p1 / (1 + exp(-p2 (dq + p3))) - p1 / (1 + exp(-p2 p3)),
// the torque that friction takes from the motor, [N m]. It is zero at rest and grows with dq.
namespace multipanda {

double friction_torque(const JointFriction& friction, std::size_t joint, double dq);

// d tau_f / d dq >= 0 [N m s/rad].
double friction_slope(const JointFriction& friction, std::size_t joint, double dq);

}  // namespace multipanda
