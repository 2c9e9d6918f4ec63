#include "backends/simulated_arm/from_scene.hpp"

#include <algorithm>
#include <stdexcept>

#include "arm_interface/arm_settings.hpp"
#include "models/arm_source.hpp"
#include "scene/build.hpp"

namespace multipanda {

std::uint64_t seed_of(std::uint64_t scene_seed, std::size_t arm) {
  std::uint64_t z = scene_seed + 0x9E3779B97F4A7C15u * (arm + 1);  // SplitMix64
  z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9u;
  z = (z ^ z >> 27) * 0x94D049BB133111EBu;
  return z ^ z >> 31;
}

namespace {

// Reported of real arms: 0.2 to 7 s, at rest too.
constexpr int kRealRecovery = 200;  // [periods]

// Real sensors have noise of their own.
PlantFidelity without_usual_noise(PlantFidelity plant) {
  const PlantFidelity usual = PlantFidelity::realistic();
  for (double PlantFidelity::*noise :
       {&PlantFidelity::noise_q_rad, &PlantFidelity::noise_dq_rad_per_s, &PlantFidelity::noise_tau_nm}) {
    if (plant.*noise == usual.*noise) plant.*noise = 0;
  }
  return plant;
}

MassExcess hand_excess(const RobotDescription& robot) {
  const RigidBody body = rigid_hand(*robot.hand);
  const Load hand{body.mass, robot.hand->mount.pose() * body.com, body.inertia},
      declared = declared_hand(hand);
  return {declared.mass - hand.mass, declared.mass * declared.p_FC - hand.mass * hand.p_FC};
}

// The model that the arm sends to programs; null: that of its links.
std::shared_ptr<const ArmModel> own_model(const SceneArm& arm, RobotDescription robot) {
  if (robot.own_model.empty()) return nullptr;
  std::copy(robot.own_model.begin(), robot.own_model.end(), robot.links.begin() + 1);
  return std::make_shared<const ArmModel>(arm_model_source(robot, arm.X_WB, arm.hand));
}

}  // namespace

SimulatedArmConfig simulated_arm_config(const Scene& scene, std::size_t arm, bool real_sensors) {
  const ArmConfig config = arm_config(scene.arms[arm]);
  const RobotDescription robot = robot_of(scene.arms[arm]), plant = plant_robot_of(scene.arms[arm]);
  // The firmware knows the rotors of the arm's model, not the motor_inertia of an individual arm.
  const bool individual = robot.motor_inertia.size() > 0;
  return {
      .model = build_arm_model(scene.arms[arm]),
      .frames = config.frames,
      .tool = config.tool,
      .load = config.load,
      .plant = real_sensors ? without_usual_noise(scene.plant) : scene.plant,
      .seed = seed_of(scene.seed, arm),
      .period_s = kArmPeriod,
      .thresholds = scene.arms[arm].collision,
      .joint_stiffness = scene.arms[arm].joint_stiffness,
      .cartesian_stiffness = scene.arms[arm].cartesian_stiffness,
      .actuation = plant.actuation,
      .torque_sensor = plant.torque_sensor,
      .transmission =
          plant.transmission ? *plant.transmission : transmission_of(scene.plant, robot.joint_count()),
      .rotor_inertia = individual ? JointVector() : acting_motor_inertia(robot, scene.arms[arm].rotor_hidden),
      .friction = friction_of(scene, robot),
      .motion_limits = MotionLimits::of(robot),
      .real_sensors = real_sensors,
      .recovery_periods = real_sensors ? kRealRecovery : 0,
      .hand_excess = real_sensors && scene.arms[arm].hand && robot.hand ? hand_excess(robot) : MassExcess{},
      .estimating_model = real_sensors ? own_model(scene.arms[arm], robot) : nullptr};
}

std::optional<JointFriction> friction_of(const Scene& scene, const RobotDescription& robot) {
  if (!scene.plant.joint_friction) return std::nullopt;
  if (!robot.friction) {
    throw std::invalid_argument("plant '" + scene.plant.name + "' has joint friction, but robot '" +
                                robot.name + "' has no friction table: switch joint friction off");
  }
  return robot.friction;
}

std::size_t checked_substeps(const Scene& scene) {
  if (scene.substeps < 1 || scene.substeps > 100) {
    throw std::invalid_argument("expected 1 to 100 physics substeps, found  " +
                                std::to_string(scene.substeps));
  }
  if (scene.arms.empty() || scene.arms.size() > kMaxArms) {
    throw std::invalid_argument("expected 1 to " + std::to_string(kMaxArms) + " arms, found " +
                                std::to_string(scene.arms.size()));
  }
  return scene.substeps;
}

}  // namespace multipanda
