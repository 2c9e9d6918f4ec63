#include "scene/hidden_plant.hpp"

#include <cmath>
#include <numbers>
#include <random>

#include "scene/build.hpp"

namespace multipanda {
namespace {

constexpr double kMass = 0.10, kCenter = 0.010, kPayload = 1.0, kPayloadReach = 0.05;  // [1], [m], [kg], [m]
constexpr double kPayloadRadius = 0.03;  // radius of the payload, a ball [m]
constexpr double kLeastFriction = 0.5, kMostFriction = 1.5;
constexpr double kDelay = 0.003, kLeastBandwidth = 30, kMostBandwidth = 100, kTorqueNoise = 0.05;
constexpr double kRotor = 0.3, kLeastTransmission = 0.5, kMostTransmission = 1.5;
constexpr double kToolShift = 0.005, kToolTurn = 2 * std::numbers::pi / 180;

class Draw {
 public:
  Draw(std::uint64_t seed, std::size_t arm) {
    std::seed_seq words{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32),
                        static_cast<std::uint32_t>(arm), 0x68696464u};
    random_.seed(words);
  }
  // The distributions of the standard library differ between implementations; this one does not.
  double between(double low, double high) {
    return low + (high - low) * static_cast<double>(random_() >> 11) * 0x1p-53;
  }
  Vector3 each_within(double bound) {
    Vector3 v;
    for (double& value : v) value = between(-bound, bound);
    return v;
  }
  Vector3 inside_ball(double radius) {
    Vector3 v;
    do v = each_within(radius);
    while (v.norm() > radius);
    return v;
  }

 private:
  std::mt19937_64 random_;
};

RigidBody drawn_link(const RigidBody& nominal, Draw& draw) {
  for (;;) {
    const double factor = draw.between(1 - kMass, 1 + kMass);
    const RigidBody body{nominal.mass * factor, nominal.com + draw.each_within(kCenter),
                         nominal.inertia * factor};
    if (is_physical(body)) return body;
  }
}

}  // namespace

RobotDescription draw_hidden_plant(const RobotDescription& nominal, std::uint64_t seed, std::size_t arm_index,
                                   const PlantFidelity& means) {
  Draw draw(seed, arm_index);
  RobotDescription robot = nominal;
  for (std::size_t i = 1; i < robot.links.size(); ++i) robot.links[i] = drawn_link(nominal.links[i], draw);

  RigidBody payload;
  payload.mass = draw.between(0, kPayload);
  payload.com = draw.inside_ball(kPayloadReach);
  payload.inertia = 0.4 * payload.mass * kPayloadRadius * kPayloadRadius * Matrix3::Identity();
  robot.links.back() = merged(robot.links.back(), moved(payload, nominal.flange.pose()));

  if (robot.friction) {
    for (double& p1 : robot.friction->p1) p1 *= draw.between(kLeastFriction, kMostFriction);
  }
  Actuation actuation;
  actuation.command_delay = draw.between(0, kDelay);
  actuation.torque_bandwidth_hz = draw.between(kLeastBandwidth, kMostBandwidth);
  robot.actuation = actuation;
  robot.torque_sensor = TorqueSensor{.gain = {}, .offset = {}, .noise = kTorqueNoise};

  // Hand, tool and tool shapes move with the flange, away from their nominal poses.
  const Vector3 shift = draw.each_within(kToolShift), axis = draw.inside_ball(1).normalized();
  const Eigen::AngleAxisd turn(draw.between(-kToolTurn, kToolTurn), axis);
  const Pose X_LF = nominal.flange.pose();
  robot.flange.position = X_LF.position + X_LF.rotation * shift;
  robot.flange.rpy = rpy_of(X_LF.rotation * turn.toRotationMatrix());

  // Drawn last, so that older draws keep their values for a given seed.
  for (double& inertia : robot.rotor_inertia) inertia *= draw.between(1 - kRotor, 1 + kRotor);
  Transmission transmission = transmission_of(means, nominal.joint_count());
  for (JointVector* part : {&transmission.stiffness, &transmission.ripple}) {
    for (double& value : *part) value *= draw.between(kLeastTransmission, kMostTransmission);
  }
  for (double& phase : transmission.ripple_phase) phase = draw.between(0, 2 * std::numbers::pi);
  robot.transmission = transmission;
  return robot;
}

void hide(Scene& scene, std::uint64_t seed) {
  const PlantFidelity given = scene.plant;
  scene.plant = PlantFidelity::realistic();
  // With the seed of the scene the noise would equal that of the simulation and cancel in comparisons.
  scene.seed ^= 0x9E3779B97F4A7C15u * (seed + 1);
  scene.plant.stiction_nm = given.stiction_nm;
  scene.plant.rotor_hidden = given.rotor_hidden;
  for (std::size_t i = 0; i < scene.arms.size(); ++i) {
    const RobotDescription nominal = robot_of(scene.arms[i]);
    if (!nominal.friction) scene.plant.joint_friction = false;
    scene.arms[i].plant_robot =
        std::make_shared<RobotDescription>(draw_hidden_plant(nominal, seed, i, given));
  }
}

}  // namespace multipanda
