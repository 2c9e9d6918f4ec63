// The motors' inertia that the arms' torque loops do not hide, in both engines: closed forms of one joint,
// energy of seven, and the torque sensor between motors and links.
#include <fstream>

#include <gtest/gtest.h>

#include "backends/mujoco/testing/test_scenes.hpp"
#include "backends/pinocchio/pinocchio_backend.hpp"
#include "scene/build.hpp"

namespace multipanda::rotor_inertia_test {
namespace {

using namespace test;

constexpr double dt = 0.001;

// One link on a joint: mass 2 kg, 0.3 m from the axis, with a rotor.
constexpr double kMass = 2, kLever = 0.3, kOwn = 0.05, kRotor = 0.4;
constexpr double kLink = kOwn + kMass * kLever * kLever;  // about the joint's axis [kg m^2]

std::string one_joint() {
  const std::string file = MULTIPANDA_BINARY_DIR "/rotor_inertia_test.yaml";
  std::ofstream(file)
      << "name: swing\ntitle: One joint\n"
         "joints: {joint1: {position_m: [0, 0, 0.3]}}\n"
         "flange: {position_m: [0, 0, 0.1]}\n"
         "inertials:\n"
         "  link0: {mass_kg: 1, com_m: [0, 0, 0], "
         "inertia_kg_m2: {xx: 0.01, yy: 0.01, zz: 0.01, xy: 0, xz: 0, yz: 0}}\n"
         "  link1: {mass_kg: 2, com_m: [0.3, 0, 0.02], "
         "inertia_kg_m2: {xx: 0.04, yy: 0.04, zz: 0.05, xy: 0, xz: 0, yz: 0}}\n"
         "limits: {joint1: {lower_rad: -3, upper_rad: 3, velocity_rad_per_s: 5, effort_nm: 50}}\n"
         "interface_limits: {acceleration_rad_per_s2: [20], jerk_rad_per_s3: [5000], "
         "torque_rate_nm_per_s: [10000]}\n"
         "rotor_inertia_kg_m2: [0.4]\n"
         "home_rad: [0.5]\n"
         "self_collision: {capsules: {}, ignored_pairs: []}\n";
  return file;
}

SceneArm swing(double hidden) {
  SceneArm arm = arm_named("a", pose(0.3, -0.4, 0.2, 0.7, -0.4, 1.1), false);
  arm.model = one_joint();
  arm.q_start = joint_constant(1, 0.5);
  arm.rotor_hidden = hidden;
  return arm;
}

SceneArm seven(double hidden, const std::string& model = "fer") {
  SceneArm arm = arm_named("a", pose(0.3, -0.4, 0.2, 0.7, -0.4, 1.1));
  arm.model = model;
  arm.rotor_hidden = hidden;
  return arm;
}

JointVector sines(int k) {
  JointVector tau(7);
  for (int i = 0; i < 7; ++i) {
    tau[i] = (i < 4 ? 4.0 : 0.1) * std::sin(2 * M_PI * (1.5 + 0.4 * i) * k * dt) * std::min(1.0, 0.01 * k);
  }
  return tau;
}

// A constant torque, gravity compensated: ddq = tau / (I + (1 - hidden) B), and the sensor shows the part
// that moves the link, tau_J = g + I ddq, on a tilted base off the origin.
TEST(RotorInertia, OneJointAcceleratesByTheClosedForm) {
  for (const double hidden : {0.0, 0.3, 1.0}) {
    const SceneArm arm = swing(hidden);
    Loop mujoco(scene_of({arm}));
    mujoco.unwatch();
    PinocchioBackend pinocchio(scene_of({arm}));
    pinocchio.start();
    std::vector<ArmState> state(1);
    std::vector<ArmCommand> command(1);
    command[0].tau_cmd = mujoco.commands[0].tau_cmd = joint_constant(1, 0.2);
    (void)pinocchio.wait();
    ModelTerms terms = terms_of(arm);
    const double acting = (1 - hidden) * kRotor, expected = 0.2 / (kLink + acting);
    for (int k = 1; k <= 500; ++k) {
      terms.update(mujoco.state().q, mujoco.state().dq);
      mujoco.step();
      pinocchio.write(ArmSet::all(1), command);
      (void)pinocchio.wait();
      pinocchio.read(ArmSet::all(1), state);
      ASSERT_NEAR(mujoco.state().dq[0], expected * k * dt, 1e-9) << hidden;
      // Within a period Runge-Kutta follows the gravity that its motor torque no longer matches exactly.
      ASSERT_NEAR(state[0].dq[0], expected * k * dt, 1e-2 * expected * k * dt) << hidden;
      ASSERT_NEAR(mujoco.state().tau_J[0] - terms.g()[0], kLink * expected, 1e-9) << hidden;
    }
  }
}

// In random states: (M + (1 - hidden) B) ddq = tau - c, and tau_J = M ddq + c + g of the links alone.
TEST(RotorInertia, TheSensorStaysOnTheLinksSide) {
  std::mt19937 random(11);
  for (const char* model : {"fer", "fr3"}) {
    const JointVector rotor = load_robot(model).rotor_inertia;
    ASSERT_EQ(rotor.size(), 7);
    for (const double hidden : {0.0, 0.6, 1.0}) {
      const SceneArm arm = seven(hidden, model);
      Loop loop(scene_of({arm}));
      loop.unwatch();
      ModelTerms terms = terms_of(arm);
      const auto& limits = terms.model().limits();
      for (int trial = 0; trial < 20; ++trial) {
        const JointVector q = random_between(limits.q_min, limits.q_max, random);
        const JointVector dq = random_between(-limits.dq_max, limits.dq_max, random);
        loop.commands[0].tau_cmd = random_between(-0.2 * limits.tau_max, 0.2 * limits.tau_max, random);
        set_plant(loop.backend, 0, q, dq);
        terms.update(q, dq);
        loop.step();
        if (loop.backend.world().data()->ncon > 0) continue;
        JointMatrix inertia = terms.M();
        inertia.diagonal() += (1 - hidden) * rotor;
        const JointVector ddq = inertia.ldlt().solve(loop.commands[0].tau_cmd - terms.c());
        EXPECT_LT((loop.state().dq - dq - dt * ddq).cwiseAbs().maxCoeff(), 1e-7) << model << hidden;
        const JointVector links = terms.M() * ddq + terms.c() + terms.g();
        EXPECT_LT((loop.state().tau_J - links).cwiseAbs().maxCoeff(), 1e-6) << model << hidden;
      }
    }
  }
}

// The work of the commanded torques is the kinetic energy of links and rotors,
// 1/2 dq^T (M + B) dq, for both shares.
TEST(RotorInertia, WorkBecomesKineticEnergyOfLinksAndRotors) {
  for (const double hidden : {0.0, 1.0}) {
    const SceneArm arm = seven(hidden);
    Scene scene = scene_of({arm});
    scene.substeps = 20;
    PinocchioBackend backend(scene);
    backend.start();
    std::vector<ArmState> state(1);
    std::vector<ArmCommand> command(1);
    (void)backend.wait();
    backend.read(ArmSet::all(1), state);
    ModelTerms terms = terms_of(arm);
    double work = 0, energy = 0;
    for (int k = 0; k < 180; ++k) {  // later a joint is too fast
      command[0].tau_cmd = sines(k);
      const JointVector q = state[0].q;
      backend.write(ArmSet::all(1), command);
      (void)backend.wait();
      backend.read(ArmSet::all(1), state);
      work += command[0].tau_cmd.dot(state[0].q - q);
      terms.update(state[0].q, state[0].dq);
      JointMatrix inertia = terms.M();
      inertia.diagonal() += (1 - hidden) * load_robot("fer").rotor_inertia;
      energy = std::max(energy, 0.5 * state[0].dq.dot(inertia * state[0].dq));
      const double now = 0.5 * state[0].dq.dot(inertia * state[0].dq);
      ASSERT_NEAR(work, now, 2e-3 * energy + 1e-6) << k << " " << hidden;
    }
    EXPECT_GT(energy, 0.1);
  }
}

// Completely hidden rotors, the default, change no bit.
TEST(RotorInertia, HiddenRotorsChangeNoBit) {
  SceneArm bare = seven(1);
  RobotDescription robot = load_robot("fer");
  robot.rotor_inertia.resize(0);
  bare.plant_robot = std::make_shared<RobotDescription>(robot);
  const SceneArm usual = arm_named("a", bare.X_WB);
  EXPECT_EQ(usual.rotor_hidden, 1);
  Loop one(scene_of({bare}, PlantFidelity::realistic())),
      other(scene_of({usual}, PlantFidelity::realistic()));
  for (int k = 0; k < 300; ++k) {
    one.commands[0].tau_cmd = other.commands[0].tau_cmd = sines(k);
    one.step();
    other.step();
    ASSERT_EQ(one.state().q, other.state().q) << k;
    ASSERT_EQ(one.state().tau_J, other.state().tau_J) << k;
  }
}

// What identification found of one arm acts in full, whatever a torque loop hides of the rotors.
TEST(RotorInertia, TheInertiaOfAnIndividualArmReplacesIt) {
  RobotDescription robot = load_robot("fer");
  EXPECT_EQ(acting_motor_inertia(robot, 1).size(), 0);
  EXPECT_EQ(acting_motor_inertia(robot, 0.25), JointVector(0.75 * robot.rotor_inertia));
  robot.motor_inertia = joint_constant(7, 0.3);
  for (const double hidden : {0.0, 0.5, 1.0})
    EXPECT_EQ(acting_motor_inertia(robot, hidden), robot.motor_inertia);
  robot = load_robot("fer");
  robot.rotor_inertia.resize(0);
  EXPECT_EQ(acting_motor_inertia(robot, 0).size(), 0);
}

// The controllers' mass matrix is that of the links; their bounds of damping count what acts.
TEST(RotorInertia, ControllersKnowTheLinksOnly) {
  const SceneArm arm = seven(0.2), hidden = seven(1);
  ModelTerms terms(build_arm_model(arm)), links = terms_of(arm), none(build_arm_model(hidden));
  terms.update(ready(), joint_constant(7, 0.3));
  links.update(ready(), joint_constant(7, 0.3));
  EXPECT_EQ(terms.M(), links.M());
  EXPECT_LT(none.model().least_inertia()[6], 0.02);
  EXPECT_GT(terms.model().least_inertia()[6], 0.16);  // 0.8 x 0.2 of the rotor
}

// Unless the scene says so: then their mass matrix contains what acts,
// and the torques that the sensor is compared with do not.
TEST(RotorInertia, ControllersKnowItIfTheSceneSaysSo) {
  SceneArm arm = seven(0.2);
  arm.safety = SafetyLimits::of(*build_arm_model(arm));
  ModelTerms links(build_controller_model(arm));
  arm.known_rotor_inertia = true;
  ModelTerms all(build_controller_model(arm));
  for (ModelTerms* terms : {&links, &all}) terms->update(ready(), joint_constant(7, 0.3));
  const JointVector rotors = 0.8 * load_robot("fer").rotor_inertia;
  JointMatrix expected = links.M();
  expected.diagonal() += rotors;
  EXPECT_EQ(all.M(), expected);
  EXPECT_EQ(all.momentum(), links.momentum());
  EXPECT_EQ(all.momentum_drift(), links.momentum_drift());
  EXPECT_EQ(all.c(), links.c());
  EXPECT_EQ(all.g(), links.g());
  // Bounds of damping count the motors once.
  EXPECT_LT((all.model().least_inertia() - links.model().least_inertia()).norm(), 1e-12);
}

// What a simulation hides says nothing of a real arm: there only the inertia that was identified counts.
TEST(RotorInertia, ARealArmsMassMatrixDoesNotFollowTheSimulation) {
  SceneArm arm = seven(0.2);
  arm.safety = SafetyLimits::of(*build_arm_model(arm));
  arm.known_rotor_inertia = true;
  const auto known = [&](const char* address) {
    arm.fci = FciConnection{.address = address};
    return build_controller_model(arm)->known_motor_inertia();
  };
  EXPECT_EQ(known("127.0.0.1"), JointVector(0.8 * load_robot("fer").rotor_inertia));
  EXPECT_EQ(known("172.16.0.2").size(), 0);
}

// The arm's own hold knows its rotors: a joint with 0.2 kg m^2 of them on FR3's bare wrist (0.002 kg m^2)
// that is pushed comes back as a critically damped oscillator of 60 rad/s does, q = q_0 + v t exp(-60 t).
TEST(RotorInertia, TheArmsOwnHoldIsDamped) {
  SceneArm arm = arm_named("a", {}, false);
  arm.model = "fr3";
  arm.rotor_hidden = 0;
  MujocoPlant plant(scene_of({arm}));
  const double v = 0.2, q_0 = plant.arm(0).state().q[6];
  plant.world().data()->qvel[plant.world().arm(0).dof[6]] = v;
  for (int k = 1; k <= 400; ++k) {
    plant.advance();
    const double t = 0.001 * k, expected = v * t * std::exp(-60 * t);
    ASSERT_NEAR(plant.arm(0).state().q[6] - q_0, expected, 0.15 * v / 60 * std::exp(-1)) << k;
  }
  EXPECT_LT(std::abs(plant.arm(0).state().dq[6]), 1e-3);
}

}  // namespace
}  // namespace multipanda::rotor_inertia_test
