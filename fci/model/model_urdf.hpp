#pragma once

#include <string>

#include "core/state/arm_state.hpp"
#include "models/robot_description.hpp"

namespace multipanda::fci {

// The arm's model as a string, as an arm sends it from protocol version 8 on (GetRobotModel): link0 to link7,
// the flange as `link8`, joints with limits and `position_based_velocity_limits`. The hand is not in it: it
// comes with the state (m_ee). libfranka requires these names and exactly these movable joints.
//
// Where the robot's limits do not depend on position (Panda), the offset is minus the limit, which leaves it
// in force everywhere. Throws std::invalid_argument if the robot does not have seven joints.
std::string model_urdf(const RobotDescription& robot);

// The configured load of the flange: hand (fingers closed) and tool, as one body in the flange
// (m_ee, F_x_Cee, I_ee). Mass 0 if there is neither.
// Throws std::invalid_argument if a hand is requested and the robot has none.
RigidBody end_effector(const RobotDescription& robot, bool hand, const Load& tool);

}  // namespace multipanda::fci
