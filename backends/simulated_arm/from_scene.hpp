#pragma once

#include <cstdint>
#include <optional>

#include "backends/simulated_arm/simulated_arm.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"

// Shared by all simulated backends: parts of a scene.
namespace multipanda {

// Settings of the arm's own behavior: model, frames, declared tool and load, fidelity, seed. `real_sensors`:
// SimulatedArmConfig::real_sensors, in place of the usual noise of fidelity `realistic`.
SimulatedArmConfig simulated_arm_config(const Scene& scene, std::size_t arm, bool real_sensors = false);

// The seed of an arm's noise, independent for each.
std::uint64_t seed_of(std::uint64_t scene_seed, std::size_t arm);

// The joint friction of the plant; none if the scene's fidelity has none.
// Throws std::invalid_argument if the scene requests it and the robot has no friction table.
std::optional<JointFriction> friction_of(const Scene& scene, const RobotDescription& robot);

// Physics steps per period. Throws std::invalid_argument if the number of steps or arms is out of range.
std::size_t checked_substeps(const Scene& scene);

}  // namespace multipanda
