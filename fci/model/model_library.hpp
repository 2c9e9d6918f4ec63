#pragma once

#include <cstddef>
#include <vector>

#include "fci/model/arm_numbers.hpp"
#include "models/robot_description.hpp"

namespace multipanda::fci {

// The shared library with this arm's model, for programs on x86-64 Linux: the arm's answer to
// LoadModelLibrary. Links 1 to 7 and the flange; hand and load come from the state (m_ee, m_load). Empty if
// this program was built for another processor: an arm then answers Status::error. Throws
// std::invalid_argument if the robot does not have seven joints.
std::vector<std::byte> model_library(const RobotDescription& robot);

// The numbers stored in it.
ArmNumbers arm_numbers(const RobotDescription& robot);

}  // namespace multipanda::fci
