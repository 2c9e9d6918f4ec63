#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/cycle/control_cycle.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"

// From a checked scene to what the core is built from. Off the loop only. The objects of the world are the
// plant's business (backends/).
namespace multipanda {

// multipanda's own controllets and features, and those of the libraries. Throws std::runtime_error
// (Registry::load_plugin).
Registry build_registry(const std::vector<std::string>& plugins);

// The robot of an arm: kinematics, inertials, limits, capsules, hand. Throws std::invalid_argument.
RobotDescription robot_of(const SceneArm& arm);

// What the simulated arm truly is: what plant_robot or plant_model say, else what its controllers believe.
// Throws std::invalid_argument.
RobotDescription plant_robot_of(const SceneArm& arm);
// Where its base truly stands: X_WB, turned by the tilt of `plant`.
Pose plant_base_of(const SceneArm& arm, const RobotDescription& plant);

// What the controllers know of the arm: links and hand; tool and declared load come with the ArmState
// (arm_config). `limits` of the model are the maker's; the scene's are in SceneArm::safety.
std::shared_ptr<const ArmModel> build_arm_model(const SceneArm& arm);

// Frames, tool and declared load that an arm starts with: what a backend puts into its ArmState.
struct ArmConfig {
  ArmFrames frames;  // X_FE: the scene's, else the hand's tool centre point, else the flange
  Load tool;         // beyond the hand, which belongs to the model
  Load load;         // as declared to the controllers
};
ArmConfig arm_config(const SceneArm& arm);

// Ready for ControlCycle. One arm model per arm is built.
CycleConfig build_cycle_config(const Scene& scene, std::size_t record_capacity = 0);

// The scene's timeline for MultimodeController::schedule; `place` events are the backend's and left out.
// Throws std::invalid_argument if the controller was built from another scene.
std::vector<ScheduledRequest> build_schedule(const Scene& scene, const MultimodeController& controller);

// What runs from the first cycle on, for MultimodeController::activate_at_start.
InstanceSet start_set(const Scene& scene, const MultimodeController& controller);

}  // namespace multipanda
