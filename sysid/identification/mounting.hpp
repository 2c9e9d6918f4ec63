#pragma once

#include <optional>

#include "models/robot_description.hpp"
#include "sysid/measured/measured_log.hpp"

namespace multipanda {

// The load and mounting of an arm, according to the scene in its log.
struct Mounting {
  bool hand = false;
  std::optional<RigidBody> tool;  // tool and declared load of the scene, in the flange's frame
  std::optional<RigidBody> tool_without_load;
  Vector3 gravity_B{0, 0, -9.81};  // [m/s^2]
  bool told = false;               // the log has a scene
};

// Throws std::runtime_error or std::invalid_argument if the scene cannot be rebuilt or has no such arm.
Mounting mounting_of(const MeasuredLog& log);

}  // namespace multipanda
