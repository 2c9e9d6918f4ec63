#include "tests/teleoperation/trial.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::teleoperation {
namespace {

constexpr const char* kScene = R"(
arms:
  - name: leader
    model: fer
    hand: false
    base: {position_m: [-0.6, 0.7, 0.1], rpy_rad: [0, 0, 0.7]}
    end_effector: {position_m: [0, 0, 0.22], rpy_rad: [0, 0, -pi/4]}
    tool: {mass_kg: 0.7, com_m: [0, 0, 0.1], inertia_kg_m2: {xx: 0.0024, yy: 0.0024, zz: 0.0003}}
    tool_shapes:
      - {shape: sphere, diameter_m: 0.04, position_m: [0, 0, 0.2]}
  - name: follower
    model: fer
    hand: false
    base: {position_m: [0.3, -0.6, 0.05], rpy_rad: [0, 0, -0.5]}
    end_effector: {position_m: [0, 0, 0.22], rpy_rad: [0, 0, -pi/4]}
    tool: {mass_kg: 0.7, com_m: [0, 0, 0.1], inertia_kg_m2: {xx: 0.0024, yy: 0.0024, zz: 0.0003}}
    tool_shapes:
      - {shape: sphere, diameter_m: 0.04, position_m: [0, 0, 0.2]}
controllets:
  - {name: both, type: teleoperation, arms: [leader, follower]}
active: [both]
)";

Scene scene_of(const Trial& trial, const Vector3& p_follower) {
  static const Registry registry = Registry::with_builtins();
  Scene scene = parse_scene(kScene, "teleoperation.yaml", registry);
  scene.plant = trial.plant;
  for (SceneArm& arm : scene.arms) {  // their own reflexes shall not help
    ContactThresholds none;
    none.torque_upper = none.torque_lower = joint_constant(7, 1e4);
    none.wrench_upper.setConstant(1e4);
    none.wrench_lower.setConstant(1e4);
    arm.collision = SetCollisionThresholds{.nominal = none, .acceleration = none};
  }
  interaction::set(scene, "architecture", {trial.position_force ? 1.0 : 0.0});
  interaction::set(scene, "channel_delay_s", {trial.delay_s});
  interaction::set(scene, "channel_loss", {trial.loss});
  interaction::set(scene, "scale", {trial.scale});
  interaction::set(scene, "force_scale", {trial.force_scale});
  interaction::set(scene, "tank_start_j", {trial.tank_start_j});
  interaction::set(scene, "refill_below_j", {trial.refill_below_j});
  if (trial.undeclared_kg > 0) {
    scene.arms[1].load_present = {
        .mass = trial.undeclared_kg, .p_FC = {0, 0, 0.15}, .inertia_C = 1e-3 * Matrix3::Identity()};
  }
  if (trial.table_n_per_m > 0) {
    SceneObject table;
    table.name = "table";
    table.size = {0.25, 0.25, 0.1};
    table.X_WO.position = p_follower - Vector3(0, 0, kGap + 0.05);
    table.friction = 0.3;
    table.contact = SurfaceContact{.stiffness_n_per_m = trial.table_n_per_m};
    scene.objects.push_back(table);
  }
  return scene;
}

}  // namespace

Outcome run(const Trial& trial) {
  Trial without_table = trial;
  without_table.table_n_per_m = 0;
  const Operator follower(scene_of(without_table, Vector3::Zero()).arms[1], 1);  // for its start only
  const Scene scene = scene_of(trial, follower.start().position);
  Operator person(scene.arms[0], 0);
  const Matrix3 R_map = scene.arms[1].X_WB.rotation * scene.arms[0].X_WB.rotation.transpose();
  const Vector3 p_l = person.start().position, p_f = follower.start().position;

  Outcome outcome;
  double worked = 0;
  const auto lead = [&](double t, MujocoBackend& backend, ControlCycle&) {
    if (!trial.holds(t)) return person.let_go(backend);
    constexpr double h = 1e-4;
    Pose X = person.start();
    X.position += R_map.transpose() * trial.way(t) / trial.scale;
    Vector6 V = Vector6::Zero();
    V.head<3>() = R_map.transpose() * (trial.way(t + h) - trial.way(t - h)) / (2 * h) / trial.scale;
    person.apply(backend, X, V);
  };
  const auto measure = [&](interaction::PlantSample measured, const interaction::Loop& loop) {
    Sample s{std::move(measured)};
    worked += person.work(loop.backend);
    s.environment += worked;
    const std::size_t felt = outcome.column("leader_force_n");
    s.felt = Vector3(s.outputs.data() + felt);
    s.contact = loop.cycle.data().state[1].F_K_W_true.force();
    s.led = trial.scale * R_map * (loop.terms[0].X_WE().position - p_l);
    s.error = p_f + s.led - loop.terms[1].X_WE().position;
    for (ModelTerms& terms : loop.terms) s.speed = std::max(s.speed, terms.V_WE().linear().norm());
    outcome.samples.push_back(std::move(s));
  };
  outcome.outputs = Registry::with_builtins().controllet("teleoperation")->descriptor.outputs;
  static_cast<interaction::Outcome&>(outcome) =
      interaction::run_closed_loop(scene, trial.duration_s, lead, measure);
  return outcome;
}

std::string name(const Trial& trial) {
  return fmt::format("{}, {}, table {:g} N/m, delay {:g} s, loss {:g}, scale {:g}, tanks {:g} J",
                     trial.position_force ? "position-force" : "position-position", trial.plant.name,
                     trial.table_n_per_m, trial.delay_s, trial.loss, trial.scale, trial.tank_start_j);
}

Passivity passivity(const Outcome& outcome) {
  constexpr double kAllowance = 1e-3;  // [J/s]
  Passivity found;
  found.excess = -std::numeric_limits<double>::infinity();
  found.least_tank = std::numeric_limits<double>::infinity();
  double first = 0, lowest = 0;
  std::size_t touching = 0;
  for (const Sample& s : outcome.samples) {
    const double leader = outcome.of(s, "leader_tank_j"), follower = outcome.of(s, "follower_tank_j");
    const double S = s.kinetic + leader + follower + outcome.of(s, "channel_energy_j");
    const double made = S - s.environment - kAllowance * s.t;
    if (&s == &outcome.samples.front()) first = lowest = made;
    lowest = std::min(lowest, made);
    found.gain = std::max(found.gain, made - lowest);
    found.excess = std::max(found.excess, made - first);
    found.least_tank = std::min({found.least_tank, leader, follower});
    found.least_valve = std::min(found.least_valve, outcome.of(s, "follower_valve"));
    found.imbalance = std::max(found.imbalance, std::abs(S - outcome.of(s, "stored_energy_j")));
    found.speed = std::max(found.speed, s.speed);
    if (s.contact.norm() > 0.1) ++touching;
  }
  found.contact_share = static_cast<double>(touching) / static_cast<double>(outcome.samples.size());
  return found;
}

}  // namespace multipanda::teleoperation
