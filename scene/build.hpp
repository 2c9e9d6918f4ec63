#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/cycle/control_cycle.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"

// Builds the inputs of the core from a checked scene. Off the loop only. The plant builds the objects of the
// world (backends/).
namespace multipanda {

// multipanda's own controllets and features, and those of the libraries. Throws std::runtime_error
// (core/plugin/load_plugin.hpp).
Registry build_registry(const std::vector<std::string>& plugins);

// The robot of an arm: kinematics, inertials, limits, capsules, hand. Throws std::invalid_argument.
RobotDescription robot_of(const SceneArm& arm);

// The robot of the simulated arm: plant_robot, otherwise plant_model, otherwise the robot of its controllers.
// Its motor_inertia is what acts in the plant.
// Throws std::invalid_argument.
RobotDescription plant_robot_of(const SceneArm& arm);
// What the scene's plant says of the transmission of `n` joints. Cycles of ripple per turn as in the data of
// a real Panda: 240 in joints 1 to 4, 160 in the others; phases differ between joints.
Transmission transmission_of(const PlantFidelity& plant, std::size_t n);
// Pose of its base in the plant: X_WB, turned by the tilt of `plant`.
Pose plant_base_of(const SceneArm& arm, const RobotDescription& plant);
// The same of a carried arm, in the joint's frame of its carrier: X_JB, turned by the tilt.
Pose plant_mount_of(const BaseMount& mount, const RobotDescription& plant);

// Masses that count towards the largest load: of hand and tool, and what remains for a declared payload [kg].
// Nothing remains if neither the scene nor the model says what the arm may carry.
double fixed_load(const SceneArm& arm, const RobotDescription& robot);
double largest_payload(const SceneArm& arm, const RobotDescription& robot);

// The controllers' model of the arm: links and hand; tool and declared load come with the ArmState
// (arm_config). `limits` are those of the model file; those of the scene are in SceneArm::safety.
std::shared_ptr<const ArmModel> build_arm_model(const SceneArm& arm);

// The same with known_rotor_inertia, and with the limits that the scene tightens: for the controllers, so
// that holds, features and checks of goals keep to them. The plant and the arm's own checks keep those of the
// model file. Position limits that the scene loosens stay those of the model.
std::shared_ptr<const ArmModel> build_controller_model(const SceneArm& arm);

// What the motors of real arms are assumed to add to each joint's inertia, as long as a model file states
// none: the armature of the Panda in MuJoCo's model collection (mujoco_menagerie, 0.1 kg m^2 for every
// joint). Identified values would replace it.
inline constexpr double kAssumedMotorInertia = 0.1;  // [kg m^2]

// Initial frames, tool and declared load of an arm; a backend puts them into its ArmState.
struct ArmConfig {
  ArmFrames frames;  // X_FE: of the scene, otherwise the hand's tool center point, otherwise the flange
  Load tool;         // in addition to the hand, which belongs to the model
  Load load;         // as declared to the controllers
};
ArmConfig arm_config(const SceneArm& arm);

// Ready for ControlCycle. One model per arm is built (build_controller_model).
CycleConfig build_cycle_config(const Scene& scene, std::size_t record_capacity = 0);

// The scene's timeline for MultimodeController::schedule; `place` events are left to the backend.
// Throws std::invalid_argument if the controller was built from another scene.
std::vector<ScheduledRequest> build_schedule(const Scene& scene, const MultimodeController& controller);

// Instances that run from the first cycle on, for MultimodeController::activate_at_start.
InstanceSet start_set(const Scene& scene, const MultimodeController& controller);

}  // namespace multipanda
