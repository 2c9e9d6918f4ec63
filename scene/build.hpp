#pragma once

#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/cycle/control_cycle.hpp"
#include "core/geometry/shape.hpp"
#include "core/model/arm_model.hpp"
#include "models/robot_description.hpp"
#include "scene/scene.hpp"

// Builds inputs of the core from a checked scene. Off the loop only. The plant builds the objects of the
// world (backends/).
namespace multipanda {

// multipanda's own controllets and features, and those of the libraries. Throws std::runtime_error
// (core/plugin/load_plugin.hpp).
Registry build_registry(const std::vector<std::string>& plugins);

// The robot of an arm: kinematics, inertials, limits, capsules, hand. Throws std::invalid_argument.
RobotDescription robot_of(const SceneArm& arm);

// The robot of the simulated arm: plant_robot, otherwise plant_model, otherwise the robot of its controllers.
// Its motor_inertia is the part that acts in the plant.
// Throws std::invalid_argument.
RobotDescription plant_robot_of(const SceneArm& arm);
// Transmission of `n` joints in the scene's plant. Cycles of ripple per turn follow data of a real Panda: 240
// in joints 1 to 4, 160 in the others; phases differ between joints.
Transmission transmission_of(const PlantFidelity& plant, std::size_t n);
// Pose of the base in the plant: X_WB, tilted as in `plant`.
Pose plant_base_of(const SceneArm& arm, const RobotDescription& plant);
// The same for a carried arm, in the joint frame of its carrier: X_JB, tilted.
Pose plant_mount_of(const BaseMount& mount, const RobotDescription& plant);

// The controllers' model of the arm: links and hand; tool and declared load come with the ArmState
// (arm_config). `limits` are those of the model file; those of the scene are in SceneArm::safety.
std::shared_ptr<const ArmModel> build_arm_model(const SceneArm& arm);

// The same with known_rotor_inertia, and with the limits that the scene tightens: for the controllers, so
// that holds, features and checks of goals keep to them. The plant and the arm's own checks keep those of the
// model file. Position limits that the scene loosens stay those of the model.
std::shared_ptr<const ArmModel> build_controller_model(const SceneArm& arm);

// Assumed motor inertia of each joint of real arms if the model file states none: the armature of the Panda
// in MuJoCo's model collection (mujoco_menagerie, 0.1 kg m^2 for every joint). Identified values would
// replace it.
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
// Tells the controller the scene's end effectors. Throws std::invalid_argument, with the place in the file,
// for an event that the controller refuses: joints beyond their limits, poses out of reach.
std::vector<ScheduledRequest> build_schedule(const Scene& scene, MultimodeController& controller);

// Instances that run from the first cycle on, for MultimodeController::activate_at_start.
InstanceSet start_set(const Scene& scene, const MultimodeController& controller);

// The first arm of a scene that stands on another arm (key `base_on`), or nullptr.
const SceneArm* carried_arm(const Scene& scene);

struct CarriedArmRefused : ConfigError {
  using ConfigError::ConfigError;
};

// For code that requires fixed bases. `what` is the subject of the message: "commission", "the cockpit".
// Throws CarriedArmRefused at the key `base_on` if there is a carried arm.
void refuse_carried_arms(const Scene& scene, const std::string& what);

// A scene's shape for distance computations of the core. The z axis of a plane points out of the ground.
ConvexShape convex_shape(ShapeType shape, const Vector3& size);

// Adds the tool's shapes as parts of the arm behind its last joint. They are never checked against the hand,
// the last link and the link before it. X_JF: the flange in the last joint's frame.
void add_tool_shapes(const std::vector<ToolShape>& tool, const Pose& X_JF, ArmModelSource& source);

// The fixed objects of the scene, and whether its timeline moves them. Free objects are meant to be touched.
std::vector<Obstacle> fixed_obstacles(const Scene& scene);

// Load limit of an arm's flange, hand and tool included [kg].
struct FlangeLoad {
  double hand_and_tool = 0;
  std::optional<double> rated;    // of the model; none: unknown
  std::optional<double> allowed;  // the scene's `largest_load_kg`, which replaces the rating

  std::optional<double> most() const { return allowed ? allowed : rated; }
  double payload() const { return most() ? std::max(0.0, *most() - hand_and_tool) : 0; }  // remaining payload
};
// The model's rigid hand, in the flange; mass 0: the arm has none.
Load hand_load(const SceneArm& arm);

FlangeLoad flange_load(const SceneArm& arm, const RobotDescription& robot);

// The effect of a payload in one sentence: "a payload of 0.3 kg is declared: with hand and tool (0.713
// kg) the flange carries 1.013 kg of the 3 kg that the model is rated for, 1.987 kg remain".
std::string load_text(const FlangeLoad& flange, double payload);

}  // namespace multipanda
