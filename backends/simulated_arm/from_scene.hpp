#pragma once

#include <optional>

#include "backends/simulated_arm/simulated_arm.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"

// Parts of a scene that all simulated backends use.
namespace multipanda {

// The arm's own behavior: model, frames, declared tool and load, fidelity, its own seed.
SimulatedArmConfig simulated_arm_config(const Scene& scene, std::size_t arm);

// The joint friction of the plant; none if the scene's fidelity has none.
// Throws std::invalid_argument if the scene requests it and the robot has no friction table.
std::optional<JointFriction> friction_of(const Scene& scene, const RobotDescription& robot);

// Physics steps per period. Throws std::invalid_argument if the number of steps or arms is out of range.
std::size_t checked_substeps(const Scene& scene);

}  // namespace multipanda
