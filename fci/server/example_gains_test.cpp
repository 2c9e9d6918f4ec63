// Gains of the manufacturer's joint impedance examples on virtual arms: programs of our own, in lock-step.
#include <cmath>

#include "backends/mujoco/testing/test_scenes.hpp"
#include "fci/server/testing/test_program.hpp"
#include "fci/server/virtual_arms.hpp"
#include "scene/load.hpp"

namespace multipanda::fci::example_gains_test {
namespace {

using multipanda::test::arm_named;
using multipanda::test::pose;
using multipanda::test::scene_of;
using multipanda::test::terms_of;
using test::own_address;
using test::TestProgram;

using Seven = std::array<double, 7>;

struct Gains {
  const char* of;
  Seven K, D;  // [N m/rad], [N m s/rad]
};
const Gains kCpp{
    "joint_impedance_control.cpp", {600, 600, 600, 600, 250, 150, 50}, {50, 50, 50, 50, 30, 25, 15}};
const double kCritical = 2 * std::sqrt(50.0);
const Gains kPython{"joint_impedance_example.py",
                    {50, 50, 50, 50, 50, 50, 50},
                    {kCritical, kCritical, kCritical, kCritical, kCritical, kCritical, kCritical}};

struct Motion {
  bool moved = true;  // the arm followed all the time
  double error = 0;   // at the end [rad]
  double speed = 0;   // largest in the last 0.3 s [rad/s]
  double swing = 0;   // largest change of a joint's velocity within 1 ms in the last 0.3 s [rad/s]
};

// Leads every joint of one arm along a minimum-jerk path of 2 s with the examples' law, tau = K (q_d - q) - D
// dq + c, and waits for 2 s.
Motion lead(const char* model, bool hand, bool rotors, const PlantFidelity& plant, const Gains& gains) {
  SceneArm arm = arm_named("arm", pose(0.2, -0.3, 0.1, 0, 0, 0.8));
  arm.model = model;
  arm.hand = hand;
  VirtualArmOptions options;
  options.real_sensors = true;
  options.places.push_back({.address = own_address(0),
                            .port = 0,
                            .gripper_port = 0,
                            .vacuum_port = 0,
                            .versions = VersionRange{}});
  options.pace = WorldPace::lockstep;
  options.idle_stands_still = true;
  Scene scene = scene_of({arm}, plant);
  if (rotors) let_rotors_act(scene);
  VirtualArms arms(std::move(scene), options);
  arms.start();
  TestProgram program(arms.place(0));
  ModelTerms terms = terms_of(arm);
  const Seven amplitude{0.2, 0.2, -0.2, 0.2, 0.3, -0.3, 0.4};
  RobotState state = program.start_torques();
  const auto start = state.q;
  Motion result;
  JointVector q(7), dq(7), before = multipanda::joint_constant(7, 0);
  constexpr int kRamp = 2000, kCycles = 4000, kLast = 300;
  for (int k = 0; k < kCycles; ++k) {
    if (state.robot_mode != static_cast<std::uint8_t>(RobotMode::move)) {
      result.moved = false;
      return result;
    }
    for (Eigen::Index i = 0; i < 7; ++i) {
      q[i] = state.q[static_cast<std::size_t>(i)];
      dq[i] = state.dq[static_cast<std::size_t>(i)];
    }
    terms.update(q, dq);
    const double s = std::min(1.0, static_cast<double>(k) / kRamp);
    const double share = s * s * s * (10 - 15 * s + 6 * s * s);
    RobotCommand command = program.torques(state, k + 1 == kCycles);
    result.error = 0;
    for (std::size_t i = 0; i < 7; ++i) {
      const double desired = start[i] + share * amplitude[i];
      command.tau_J_d[i] = gains.K[i] * (desired - state.q[i]) - gains.D[i] * state.dq[i] +
                           terms.c()[static_cast<Eigen::Index>(i)];
      result.error = std::max(result.error, std::abs(start[i] + amplitude[i] - state.q[i]));
    }
    if (k > kCycles - kLast) {
      result.speed = std::max(result.speed, dq.cwiseAbs().maxCoeff());
      result.swing = std::max(result.swing, (dq - before).cwiseAbs().maxCoeff());
    }
    before = dq;
    program.command(command);
    state = program.read();
  }
  return result;
}

TEST(ExampleGains, MoveArmsWithRotorsAndComeToRest) {
  for (int i = 0; i < 6; ++i) {
    const char* model = std::to_array({"fer", "fr3", "fr3v2"})[static_cast<std::size_t>(i / 2)];
    const bool hand = i % 2 == 0;
    for (const Gains& gains : {kCpp, kPython}) {
      SCOPED_TRACE(std::string(model) + (hand ? ", " : " without hand, ") + gains.of);
      const Motion ideal = lead(model, hand, true, {}, gains);
      EXPECT_TRUE(ideal.moved);
      EXPECT_LT(ideal.error, 2e-3);  // what is left of D dq / K after 2 s
      EXPECT_LT(ideal.speed, 0.01);
      EXPECT_LT(ideal.swing, 1e-4);
      // Behind 1 ms of delay and motors of 50 Hz, with the sensors of real arms and friction that holds
      // joints back.
      const Motion realistic = lead(model, hand, true, PlantFidelity::realistic(), gains);
      EXPECT_TRUE(realistic.moved);
      EXPECT_LT(realistic.error, 0.03);
      EXPECT_LT(realistic.speed, 0.02);
      EXPECT_LT(realistic.swing, 0.02);
    }
  }
}

// The same on links whose motors an ideal torque loop hides: FR3's wrist is too light for 15 N m s/rad at 1
// kHz. It rattles until the arm stops.
TEST(ExampleGains, AreTooMuchForAWristWithoutItsRotor) {
  const Motion motion = lead("fr3", true, false, {}, kCpp);
  EXPECT_TRUE(!motion.moved || motion.swing > 0.1) << motion.swing;
}

TEST(Rotors, ActUnlessTheSceneSaysHowMuchOfThemIsHidden) {
  const Registry registry = Registry::with_builtins();
  const auto hidden = [&](const char* plant) {
    Scene scene = parse_scene(std::string("arms:\n  - name: arm\n") + plant, "rotors.yaml", registry);
    let_rotors_act(scene);
    return scene.arms[0].rotor_hidden;
  };
  EXPECT_EQ(hidden(""), 0);
  EXPECT_EQ(hidden("plant: {rotor_inertia_hidden: 1}\n"), 1);
  EXPECT_EQ(hidden("plant: {rotor_inertia_hidden: 0.25}\n"), 0.25);
}

}  // namespace
}  // namespace multipanda::fci::example_gains_test
