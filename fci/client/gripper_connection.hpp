#pragma once

#include <memory>
#include <string>

#include "fci/client/end_effector.hpp"
#include "fci/wire/versions.hpp"

namespace multipanda::fci {

// The hand's gripper of one arm, and the vacuum gripper; `name`: of the arm. Not connected yet.
std::unique_ptr<EndEffector> gripper_link(const std::string& name, const std::string& address,
                                          std::uint16_t port = kGripperPort);
std::unique_ptr<EndEffector> vacuum_link(const std::string& name, const std::string& address,
                                         std::uint16_t port = kVacuumPort);

}  // namespace multipanda::fci
