#include "backends/mujoco/plant.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <stdexcept>

#include "backends/mujoco/engine.hpp"
#include "backends/simulated_arm/friction.hpp"
#include "backends/simulated_arm/from_scene.hpp"
#include "models/write_robot.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

bool has_fingers(const SceneArm& arm) { return arm.hand && arm.movable_fingers.value_or(false); }

std::optional<WorldArm::Carrier> carrier_of(const Scene& scene, const SceneArm& arm,
                                            const RobotDescription& plant) {
  if (!arm.mount) return std::nullopt;
  return WorldArm::Carrier{.name = scene.arms.at(arm.mount->carrier).name,
                           .joint = arm.mount->joint,
                           .X_JB = plant_mount_of(*arm.mount, plant)};
}

WorldArm world_arm(const Scene& scene, const SceneArm& arm, const RobotDescription& robot, bool looks) {
  const Fingers fingers = has_fingers(arm) ? Fingers::movable : Fingers::locked;
  WorldArm placed{
      .name = arm.name,
      .mjcf = to_mjcf(robot, {.hand = arm.hand, .fingers = fingers, .actuators = false, .visuals = looks}),
      .joint_count = robot.joint_count(),
      .X_WB = plant_base_of(arm, robot),
      .carrier = carrier_of(scene, arm, robot),
      .q_start = arm.q_start,
      .tool = arm.tool,
      .payload = arm.load_present,
      .tool_shapes = arm.tool_shapes};
  if (has_fingers(arm)) {
    placed.has_fingers = true;
    placed.finger_boxes = robot.hand->finger_boxes.size();
    placed.fingers_start = robot.hand->finger_travel;
  }
  if (arm.vacuum) placed.X_FE_vacuum = arm_config(arm).frames.X_FE;
  return placed;
}

std::optional<LinkFriction> link_friction_of(const RobotDescription& robot) {
  if (!robot.link_friction) return std::nullopt;
  return LinkFriction(*robot.link_friction, robot.joint_count());
}

// Iterations that keep held objects from creeping out of the fingers.
constexpr std::size_t kNoslipOfFingers = 5;

WorldPhysics world_physics(const Scene& scene, bool looks) {
  const bool grasps = std::any_of(scene.arms.begin(), scene.arms.end(), has_fingers);
  return {
      .timestep = MujocoPlant::kPeriod / static_cast<double>(checked_substeps(scene)),
      .noslip_iterations = static_cast<int>(std::max(scene.noslip_iterations, grasps ? kNoslipOfFingers : 0)),
      .stiction = scene.plant.stiction_nm,
      .looks = looks};
}

std::vector<WorldArm> arms_of_world(const PlantParts& parts, const Scene& scene) {
  std::vector<WorldArm> arms;
  for (std::size_t i = 0; i < parts.arms.size(); ++i) {
    arms.push_back(parts.arms[i].of_world);
    arms.back().q_start = scene.arms[i].q_start;
  }
  return arms;
}

}  // namespace

PlantParts::PlantParts(const Scene& scene, const PlantOptions& options)
    : physics(world_physics(scene, options.looks)) {
  for (std::size_t i = 0; i < scene.arms.size(); ++i) {
    const SceneArm& arm = scene.arms[i];
    RobotDescription robot = plant_robot_of(arm);
    WorldArm of_world = world_arm(scene, arm, robot, options.looks);
    const bool real_sensors = (options.real_sensors || scene.plant.real_sensors) && !arm.plant_robot;
    if (real_sensors && !robot.link_friction) robot.link_friction = usual_link_friction(robot);
    arms.push_back({.of_world = std::move(of_world),
                    .behavior = simulated_arm_config(scene, i, real_sensors),
                    .friction = friction_of(scene, robot),
                    .link_friction = link_friction_of(robot),
                    .motor_inertia = robot.motor_inertia,
                    .gripper = {}});
    if (!has_fingers(arm)) continue;
    const HandDescription& hand = *robot.hand;
    arms.back().gripper = {2 * hand.finger_travel, hand.finger_velocity, hand.finger_effort};
  }
  model.reset(compose(arms_of_world(*this, scene), scene.objects, physics));
  for (Arm& arm : arms) arm.of_world.mjcf.clear();  // compiled: every plant copies the rest
}

MujocoPlant::MujocoPlant(const Scene& scene, const PlantParts& parts, const PlantOptions& options)
    : substeps_(checked_substeps(scene)),
      world_(*parts.model, arms_of_world(parts, scene), scene.objects, parts.physics),
      pushes_(world_.objects().size()),
      has_stiction_(scene.plant.stiction_nm > 0) {
  if (options.timeline_waits) timeline_origin_.reset();
  plan_places(scene);
  for (std::size_t i = 0; i < scene.arms.size(); ++i) {
    const PlantParts::Arm& part = parts.arms[i];
    SimulatedArmConfig behavior = part.behavior;
    behavior.seed = seed_of(scene.seed, i);
    const JointVector& q_start = scene.arms[i].q_start;
    const JointVector zero = joint_constant(part.of_world.joint_count, 0);
    arms_.push_back({.behavior = SimulatedArm(std::move(behavior), q_start),
                     .friction = part.friction,
                     .link_friction = part.link_friction,
                     .motor_inertia = part.motor_inertia,
                     .q_start = q_start,
                     .q = zero,
                     .dq = zero,
                     .tau_motor = zero,
                     .friction_explicit = zero,
                     .friction_slope = zero,
                     .measurement = {.q = zero, .dq = zero, .tau_link = zero, .has_contact_truth = true}});
    if (part.gripper) arms_.back().gripper.emplace(*part.gripper, part.gripper->width);
    if (scene.arms[i].vacuum) arms_.back().vacuum.emplace();
    if (scene.arms[i].force_sensor) arms_.back().X_FS = scene.arms[i].force_sensor->mount.X_FS;
  }
  for (ArmIndex i = 0; i < arms_.size(); ++i) measure_start(i);
  feel(true);
}

void MujocoPlant::advance() {
  if (failed_) return;
  for (auto& arm : arms_) {
    arm.measurement.tau_link.setZero();
    arm.measurement.F_K_W_true = {};
  }
  if (!carry_out_places()) return;
  apply_pushes();
  const double dt = kPeriod / static_cast<double>(substeps_), weight = 1.0 / static_cast<double>(substeps_);
  for (ArmIndex i = 0; i < arms_.size(); ++i) drive_grippers(i);
  for (std::size_t step = 0; step < substeps_; ++step) {
    for (ArmIndex i = 0; i < arms_.size(); ++i) drive(i, dt);
    if (!world_.step()) {
      fail(*last_engine_error() != '\0'
               ? last_engine_error()
               : "the simulation diverged: positions or velocities are out of range");
      return;
    }
    for (ArmIndex i = 0; i < arms_.size(); ++i) observe(i, weight);
  }
  ++periods_;
  for (auto& arm : arms_) arm.behavior.measure(arm.measurement);
  feel(false);
}

// The force sensors' view of the last physics step.
void MujocoPlant::feel(bool at_rest) {
  if (std::ranges::none_of(arms_, [](const Arm& arm) { return arm.X_FS.has_value(); })) return;
  world_.update_loads(at_rest);
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    Arm& arm = arms_[i];
    if (!arm.X_FS) continue;
    arm.force.F_S = arm.force.mean_S = world_.sensor_load(i, *arm.X_FS);
    ++arm.force.records;
  }
}

void MujocoPlant::plan_places(const Scene& scene) {
  for (const auto& event : scene.timeline) {
    if (event.what != TimelineEvent::What::place) continue;
    const auto object = world_.find_object(event.object);
    if (!object)
      throw std::invalid_argument("the timeline places '" + event.object +
                                  "', but the scene has no such object");
    constexpr double kRounding = 1e-6;  // of a period
    const auto period = static_cast<std::int64_t>(std::ceil(event.at_s / kPeriod - kRounding));
    places_.push_back({.period = period, .object = *object, .X_WO = event.X_WO});
  }
  std::stable_sort(places_.begin(), places_.end(),
                   [](const auto& a, const auto& b) { return a.period < b.period; });
}

void MujocoPlant::begin_timeline() {
  if (!timeline_origin_) timeline_origin_ = periods_;
}

std::optional<Pose> MujocoPlant::object_pose(const std::string& name) const {
  const auto object = world_.find_object(name);
  return object ? std::optional(world_.X_WO(*object)) : std::nullopt;
}

bool MujocoPlant::carry_out_places() {
  if (!timeline_origin_) return true;
  const std::int64_t now = periods_ - *timeline_origin_;
  for (; next_place_ < places_.size() && places_[next_place_].period <= now; ++next_place_) {
    const PlannedPlace& place = places_[next_place_];
    if (this->place(place.object, place.X_WO)) continue;
    std::array<char, 256> why{};
    std::snprintf(why.data(), why.size(), "the timeline places '%s' inside another object",
                  world_.objects()[place.object].name.c_str());
    fail(why.data());
    return false;
  }
  return true;
}

GripperState MujocoPlant::gripper_state(ArmIndex i) const {
  const Arm& arm = arms_[i];
  if (arm.gripper) return arm.gripper->state();
  return arm.vacuum ? arm.vacuum->gripper_state() : GripperState{};
}

// Forces of motors and pumps in this period, from the current state of fingers and parts.
void MujocoPlant::drive_grippers(ArmIndex i) {
  Arm& arm = arms_[i];
  if (arm.gripper) {
    const World::FingerState fingers = world_.fingers(i);
    world_.push_fingers(i, arm.gripper->step(fingers.width, fingers.rate, kPeriod));
  }
  if (arm.vacuum) {
    const auto held = world_.held(i);
    const auto at_cup = held ? held : world_.object_at_cup(i, arm.vacuum->limits().reach);
    const bool holds = arm.vacuum->step(at_cup.has_value(), world_.cup_wrench(i), kPeriod);
    if (!holds && held) world_.let_go(i);
    if (holds && !held) world_.hold(i, *at_cup);
  }
}

// Motor torque less friction goes to the joints. The slope of friction can make an explicit step of a light
// joint unstable, so it is split: D = tau_f'(dq) goes to MuJoCo as damping, which its integrator takes at the
// end of the step, the rest is applied: in effect tau_f(dq) + D (dq_after - dq).
void MujocoPlant::drive(ArmIndex index, double dt) {
  Arm& arm = arms_[index];
  const World::ArmPlaces& places = world_.arm(index);
  world_.joints(index, arm.q, arm.dq);
  arm.tau_motor = arm.behavior.motor_torque(arm.q, arm.dq, dt);
  if (arm.link_friction) arm.link_friction->begin(arm.dq, world_.joint_inertia(index), dt);
  for (std::size_t j = 0; j < places.dof.size(); ++j) {
    const auto i = static_cast<Eigen::Index>(j);
    const int dof = places.dof[j];
    if (arm.friction) {
      const double slope = friction_slope(*arm.friction, j, arm.dq[i]);
      world_.model()->dof_damping[dof] = arm.friction_slope[i] = slope;
      arm.friction_explicit[i] = friction_torque(*arm.friction, j, arm.dq[i]) - slope * arm.dq[i];
    }
    world_.data()->qfrc_applied[dof] = arm.tau_motor[i] - arm.friction_explicit[i];
    if (arm.link_friction) {
      world_.model()->dof_damping[dof] = arm.friction_slope[i] + arm.link_friction->slope()[i];
      world_.data()->qfrc_applied[dof] -= arm.link_friction->constant()[i];
    }
  }
}

// Adds the sensors' view of a physics step. `weight`: the step's fraction of the period. Inertia J and
// friction of the motors lie before the torque sensor: tau_J = tau_motor - tau_f - J ddq.
void MujocoPlant::observe(ArmIndex index, double weight) {
  Arm& arm = arms_[index];
  PlantMeasurement& seen = arm.measurement;
  world_.joints(index, seen.q, seen.dq);
  const auto& dof = world_.arm(index).dof;
  for (std::size_t j = 0; j < dof.size(); ++j) {
    const auto i = static_cast<Eigen::Index>(j);
    const double damping = arm.friction_slope[i] * seen.dq[i];
    const double stiction = has_stiction_ ? world_.stiction_torque(dof[j]) : 0.0;
    seen.tau_link[i] += weight * (arm.tau_motor[i] - arm.friction_explicit[i] - damping + stiction);
    if (arm.motor_inertia.size() > 0) {
      seen.tau_link[i] -=
          arm.motor_inertia[i] * (seen.dq[i] - arm.dq[i]) / kPeriod;  // weight / dt = 1 / period
    }
  }
  if (arm.link_friction) arm.link_friction->end(seen.dq, weight * kPeriod);
  // Contacts and MuJoCo's flange pose belong to the start of the step.
  const ArmFrames& frames = arm.behavior.settings().frames;
  const Pose X_WK = world_.X_WF(index) * frames.X_FE * frames.X_EK;
  seen.F_K_W_true.vector += weight * world_.tip_wrench(index, X_WK.position).vector;
}

void MujocoPlant::fail(const char* why) {
  failed_ = true;
  const std::size_t size = std::min(std::strlen(why), fault_.size() - 1);
  std::memcpy(fault_.data(), why, size);
  fault_[size] = '\0';
}

std::string MujocoPlant::find_free(const std::string& name, const char* done, std::size_t& object) const {
  const auto found = world_.find_object(name);
  if (!found) return "there is no object '" + name + "' in the scene";
  if (world_.objects()[*found].qpos < 0)
    return "object '" + name + "' is fixed: only free objects can be " + done;
  object = *found;
  return {};
}

std::string MujocoPlant::locate(const WorldRequest& request, std::size_t& object) const {
  if (const auto* place = std::get_if<PlaceObject>(&request)) {
    if (auto why = find_free(place->object, "placed", object); !why.empty()) return why;
    return check_pose(place->X_WO, "X_WO");
  }
  if (const auto* push = std::get_if<PushObject>(&request)) {
    if (auto why = find_free(push->object, "pushed", object); !why.empty()) return why;
    if (!(push->f_W.norm() <= PushObject::kMostForce)) return "the force must be at most 100 N";
    if (!(push->duration > 0 && push->duration <= PushObject::kMostTime))
      return "the push must last more than 0 and at most 2 s";
  }
  return {};
}

bool MujocoPlant::place(std::size_t object, const Pose& X_WO) {
  if (!world_.place(object, X_WO)) return false;
  if (pushes_[object].periods > 0) pushes_[object].periods = 0;
  return true;
}

void MujocoPlant::push(std::size_t object, const Vector3& f_W, double duration_s) {
  pushes_[object] = {.f_W = f_W, .periods = std::max<std::int64_t>(1, std::lround(duration_s / kPeriod))};
}

void MujocoPlant::apply_pushes() {
  for (std::size_t i = 0; i < pushes_.size(); ++i) {
    Push& push = pushes_[i];
    if (push.periods < 0) continue;
    const Vector3 f_W = push.periods > 0 ? push.f_W : Vector3::Zero();
    Eigen::Map<Vector3>(world_.data()->xfrc_applied + 6 * world_.objects()[i].body) = f_W;
    --push.periods;  // a last time with zero, to end it
  }
}

void MujocoPlant::reset() {
  if (!world_.reset()) return fail(last_engine_error());
  for (Push& push : pushes_) push.periods = std::min<std::int64_t>(push.periods, 0);
  for (ArmIndex i = 0; i < arms_.size(); ++i) {
    Arm& arm = arms_[i];
    arm.behavior.reset(arm.q_start);
    arm.friction_explicit.setZero();
    arm.friction_slope.setZero();
    if (arm.link_friction) arm.link_friction->reset();
    if (arm.gripper) arm.gripper->reset(world_.fingers(i).width);
    if (arm.vacuum) arm.vacuum->reset();
    measure_start(i);
  }
  feel(true);
}

// The initial packet: at rest, motors support the arm.
void MujocoPlant::measure_start(ArmIndex i) {
  Arm& arm = arms_[i];
  world_.joints(i, arm.q, arm.dq);
  arm.tau_motor = arm.behavior.motor_torque(arm.q, arm.dq, 0);
  arm.measurement.tau_link.setZero();
  arm.measurement.F_K_W_true = {};
  observe(i, 1.0);
  arm.behavior.measure(arm.measurement);
}

}  // namespace multipanda
