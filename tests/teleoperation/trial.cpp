#include "tests/teleoperation/trial.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <memory>
#include <random>

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

namespace {

// From 0 at `from` to 1 at `to`, without a step of the velocity.
double rise(double t, double from, double to) {
  const double u = std::clamp((t - from) / (to - from), 0.0, 1.0);
  return u * u * u * (10 + u * (6 * u - 15));
}

std::string fault_of(const Outcome& outcome) {
  return outcome.kept && outcome.fault.empty() ? "" : outcome.fault + outcome.rules;
}

}  // namespace

FreeMotion free_motion(Trial trial) {
  trial.table_n_per_m = 0;
  trial.duration_s = 8;
  trial.way = [size = std::min(1.0, trial.scale)](double t) -> Vector3 {
    const double a = size * rise(t, 0.5, 2.5);
    return a * Vector3(0.05 * std::sin(2.4 * t), 0.06 * (1 - std::cos(1.9 * t)), 0.04 * std::sin(2.9 * t));
  };
  const Outcome outcome = run(trial);
  FreeMotion found;
  found.fault = fault_of(outcome);
  for (const Sample& s : outcome.samples) {
    found.largest_error = std::max(found.largest_error, s.error.norm());
    found.largest_felt = std::max(found.largest_felt, s.felt.norm());
  }
  return found;
}

Contact contact(Trial trial) {
  trial.duration_s = 8;
  trial.way = [](double t) {
    const double depth = kGap + 0.02;
    return Vector3(0, 0, -depth * rise(t, 0.5, 2.5) - 0.03 * rise(t, 4, 5));
  };
  const Outcome outcome = run(trial);
  Contact found;
  found.fault = fault_of(outcome);
  for (const Sample& s : outcome.samples) {
    const double F = s.contact.norm();
    found.peak = std::max(found.peak, F);
    if (s.t > 7.5) found.pressed = F;
    if (F > 5 && s.t > 3) found.error = std::max(found.error, std::abs(s.felt.norm() - F) / F);
  }
  return found;
}

Response response(double frequency_hz) {
  const double w = 2 * M_PI * frequency_hz;
  const double amplitude = std::min(0.03, 0.1 / w);
  Trial trial;
  trial.duration_s = 3 + 4 / frequency_hz;
  trial.way = [=](double t) { return Vector3(0, 0, amplitude * rise(t, 0.3, 2) * std::sin(w * t)); };
  const Outcome outcome = run(trial);
  // Over whole periods at the end, both hands along z, to which R_map is the identity.
  std::complex<double> led = 0, followed = 0;
  const double from = 3;
  for (const Sample& s : outcome.samples) {
    if (s.t < from) continue;
    const std::complex<double> turn(std::cos(w * s.t), -std::sin(w * s.t));
    led += s.led.z() * turn;
    followed += (s.led.z() - s.error.z()) * turn;
  }
  const std::complex<double> H = followed / led;
  return {std::abs(H), std::arg(H)};
}

Trial disturbed(Trial trial, std::uint32_t seed) {
  std::mt19937 random(seed);
  const auto between = [&random](double a, double b) {
    return std::uniform_real_distribution<double>(a, b)(random);
  };
  struct Stop {
    double at;
    Vector3 p;
    bool holds;
  };
  auto stops = std::make_shared<std::vector<Stop>>();
  const auto place = [&] {
    const double z = between(-0.05, 0.02), y = between(-0.04, 0.04);
    return Vector3(between(-0.04, 0.04), y, z);
  };
  for (double t = 0.5; t < 8; t += between(0.4, 1.0)) {
    stops->push_back({t, place(), between(0, 1) > 0.15});
  }
  const auto current = [stops](double t) {
    std::size_t i = 0;
    while (i + 1 < stops->size() && (*stops)[i + 1].at <= t) ++i;
    return i;
  };
  trial.duration_s = 8;
  trial.way = [stops, current](double t) -> Vector3 {
    const std::size_t i = current(t);
    if (t < (*stops)[0].at) return Vector3::Zero();
    const Vector3 before = i == 0 ? Vector3(Vector3::Zero()) : (*stops)[i - 1].p;
    return before + rise(t, (*stops)[i].at, (*stops)[i].at + 0.35) * ((*stops)[i].p - before);
  };
  trial.holds = [stops, current](double t) { return (*stops)[current(t)].holds; };
  return trial;
}

}  // namespace multipanda::teleoperation
