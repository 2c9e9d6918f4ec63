#pragma once

#include <optional>
#include <span>

#include "models/robot_description.hpp"
#include "sysid/measured/measured_log.hpp"

namespace multipanda {

// Load and mounting of an arm according to the scene in its log, or (base only) to the log itself.
struct Mounting {
  bool hand = false;
  std::optional<RigidBody> tool;  // tool and declared load of the scene, in the flange's frame
  std::optional<RigidBody> tool_without_load;
  Vector3 gravity_B{0, 0, -9.81};  // [m/s^2]
  bool told = false;               // the log has a scene
  bool base_told = false;          // gravity_B is from the scene, the log or an option; otherwise: level
};

// Throws std::runtime_error or std::invalid_argument if the scene cannot be rebuilt or has no such arm.
Mounting mounting_of(const MeasuredLog& log);

// Bases that turn gravity by less than a degree against each other count as one.
bool same_gravity(const Vector3& a, const Vector3& b);

// Text for a base: "gravity along (0.00, 0.00, -1.00) of its base".
std::string in_words(const Mounting& mounting);

// Throws LogRefused if logs cannot be combined: with and without hand, with different tools, or if some give
// a base that is not level and others give none. `logs` and `mountings` in the same order; `with_load`: which
// of the mountings' tools counts.
void refuse_unlike(std::span<const MeasuredLog> logs, std::span<const Mounting> mountings, bool with_load);

}  // namespace multipanda
