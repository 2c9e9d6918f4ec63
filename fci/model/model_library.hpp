#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/state/arm_state.hpp"
#include "fci/model/arm_numbers.hpp"
#include "models/robot_description.hpp"

namespace multipanda::fci {

// Which model an arm's library computes: the arm's own (RobotDescription::own_model), if it has one, or that
// of the scene's links.
enum class LibraryModel : std::uint8_t { own, scene };

// The shared library with this arm's model, for programs on x86-64 Linux: the arm's answer to
// LoadModelLibrary. Links 1 to 7 and the flange; hand and load come from the state (m_ee, m_load). Empty if
// this program was built for another processor: an arm then answers Status::error. Throws
// std::invalid_argument if the robot does not have seven joints.
std::vector<std::byte> model_library(const RobotDescription& robot, LibraryModel model);

// The numbers stored in it.
ArmNumbers arm_numbers(const RobotDescription& robot, LibraryModel model);

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
