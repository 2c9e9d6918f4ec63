#pragma once

#include <optional>

#include "backends/arm/simulated_arm.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"

// What every simulated backend takes from a scene in the same way.
namespace multipanda {

inline constexpr double kArmPeriod = 0.001;  // of the control interface [s]

// The arm's own behaviour: model, frames, declared tool and load, fidelity, its own seed.
SimulatedArmConfig simulated_arm_config(const Scene& scene, std::size_t arm);

// The joint friction of the plant; none where the scene's fidelity has none.
// Throws std::invalid_argument when the scene asks for it and the robot has no table.
std::optional<JointFriction> friction_of(const Scene& scene, const RobotDescription& robot);

// Physics steps per period. Throws std::invalid_argument on senseless numbers of steps or arms.
std::size_t checked_substeps(const Scene& scene);

}  // namespace multipanda
