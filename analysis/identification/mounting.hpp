#pragma once

#include <optional>

#include "analysis/measured/measured_log.hpp"
#include "models/robot_description.hpp"

namespace multipanda {

// What an arm carries and how it stands, as far as the scene in its log says.
struct Mounting {
  bool hand = false;
  std::optional<RigidBody> tool;  // tool and declared load of the scene, in the flange's frame
  std::optional<RigidBody> tool_without_load;
  Vector3 gravity_B{0, 0, -9.81};  // [m/s^2]
  bool told = false;               // the log has a scene
};

// Throws std::runtime_error or std::invalid_argument if there is a scene and it cannot be rebuilt, or it has
// no such arm.
Mounting mounting_of(const MeasuredLog& log);

}  // namespace multipanda
