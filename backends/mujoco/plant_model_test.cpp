// Checks the simulated arm against independent formulas where it differs from what its controllers assume.
#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "backends/mujoco/testing/test_scenes.hpp"
#include "backends/pinocchio/pinocchio_backend.hpp"
#include "models/write_robot.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::plant_model_test {
namespace {

using namespace test;

constexpr double dt = 0.001;

JointVector joints(std::initializer_list<double> values) {
  JointVector v(static_cast<Eigen::Index>(values.size()));
  std::copy(values.begin(), values.end(), v.begin());
  return v;
}

SceneArm arm_that_is(const RobotDescription& plant, bool hand = true) {
  SceneArm arm = arm_named("a", {}, hand);
  arm.plant_robot = std::make_shared<RobotDescription>(plant);
  return arm;
}

// Terms of the true arm, built separately from the backend's.
ModelTerms true_terms(const RobotDescription& plant, bool hand = true, const Pose& X_WB = {}) {
  return ModelTerms(std::make_shared<const ArmModel>(arm_model_source(plant, X_WB, hand)));
}

RobotDescription heavier(double factor) {
  RobotDescription robot = load_robot("fer");
  for (auto& link : robot.links) {
    link.mass *= factor;
    link.inertia *= factor;
    link.com += Vector3(0.004, -0.003, 0.005);
  }
  return robot;
}

// Joint torques of several sines, small enough to stay in range, different in every joint.
JointVector sines(int k) {
  JointVector tau(7);
  for (int i = 0; i < 7; ++i) {
    tau[i] = (i < 4   ? 6.0
              : i < 6 ? 1.5
                      : 0.8) *
             std::sin(2 * M_PI * (1.5 + 0.4 * i) * k * dt) * std::min(1.0, 0.01 * k);
  }
  return tau;
}

// tau_J = M ddq + c + g + friction beyond the sensor, with the true arm's terms, in every period, for any
// motor friction and inertia.
TEST(PlantModel, SensorShowsWhatMovesTheLinksAndTheFrictionBeyondIt) {
  RobotDescription plant = heavier(1.1);
  plant.motor_inertia = joints({0.4, 0.4, 0.3, 0.3, 0.1, 0.1, 0.05});
  FrictionLaw law;
  law.offset = joints({0.1, -0.2, 0.05, 0.1, -0.1, 0.02, 0.03});
  law.viscous = joints({1, 2, 1.5, 0.5, 0.4, 0.3, 0.2});
  plant.link_friction = law;
  plant.friction->p1 *= 1.3;
  Loop loop(scene_of({arm_that_is(plant)}, {.name = "rubbing", .joint_friction = true}));
  loop.unwatch();
  ModelTerms terms = true_terms(plant);
  double moved_most = 0, friction_most = 0;
  for (int k = 0; k < 800; ++k) {
    const JointVector q = loop.state().q, dq = loop.state().dq;
    terms.update(q, dq);
    loop.commands[0].tau_cmd = sines(k);
    loop.step();
    const JointVector ddq = (loop.state().dq - dq) / dt;
    const JointVector friction = law.offset + law.viscous.cwiseProduct(loop.state().dq);
    const JointVector expected = terms.M() * ddq + terms.c() + terms.g() + friction;
    ASSERT_LT((expected - loop.state().tau_J).cwiseAbs().maxCoeff(), 1e-6) << k;
    moved_most = std::max(moved_most, ddq.cwiseAbs().maxCoeff());
    friction_most = std::max(friction_most, friction.cwiseAbs().maxCoeff());
  }
  EXPECT_GT(moved_most, 5);
  EXPECT_GT(friction_most, 0.5);
}

// The motor side: the sensor shows the motor torque less inertia and the plant's own friction table.
TEST(PlantModel, MotorsHaveInertiaAndTheirOwnFriction) {
  RobotDescription plant = load_robot("fer");
  plant.motor_inertia = joints({0.4, 0.4, 0.3, 0.3, 0.1, 0.1, 0.05});
  plant.friction->p1 *= 1.5;
  const SceneArm arm = arm_that_is(plant);
  Loop loop(scene_of({arm}, {.name = "rubbing", .joint_friction = true}));
  loop.unwatch();
  ModelTerms nominal = terms_of(arm);
  for (int k = 0; k < 400; ++k) {
    const JointVector q = loop.state().q, dq = loop.state().dq;
    nominal.update(q, dq);
    loop.commands[0].tau_cmd = sines(k);
    loop.step();
    for (int i = 0; i < 7; ++i) {
      const auto table = [&](double v) {
        const double p1 = plant.friction->p1[i], p2 = plant.friction->p2[i], p3 = plant.friction->p3[i];
        return 0.5 * p1 * (std::tanh(0.5 * p2 * (v + p3)) - std::tanh(0.5 * p2 * p3));
      };
      const double change = loop.state().dq[i] - dq[i];
      const double motor = loop.commands[0].tau_cmd[i] + nominal.g()[i];  // the arm compensates by its model
      const double p2 = plant.friction->p2[i];
      EXPECT_NEAR(loop.state().tau_J[i],
                  motor - plant.motor_inertia[i] * change / dt - table(loop.state().dq[i]),
                  0.5 * 0.1 * plant.friction->p1[i] * p2 * p2 * change * change + 1e-7)
          << k << " " << i;
    }
  }
}

TEST(PlantModel, OneStepAcceleratesMotorsAndLinks) {
  RobotDescription plant = load_robot("fer");
  plant.motor_inertia = joints({0.4, 0.4, 0.3, 0.3, 0.1, 0.1, 0.05});
  Loop loop(scene_of({arm_that_is(plant)}));
  loop.unwatch();
  ModelTerms terms = true_terms(plant);
  terms.update(ready(), joint_constant(7, 0));
  loop.commands[0].tau_cmd = joints({1, -2, 3, 1, 0.5, -0.5, 0.2});
  loop.step();
  JointMatrix inertia = terms.M();
  inertia.diagonal() += plant.motor_inertia;
  const JointVector expected = dt * inertia.ldlt().solve(loop.commands[0].tau_cmd);
  EXPECT_LT((loop.state().dq - expected).cwiseAbs().maxCoeff(), 1e-9);
  EXPECT_GT((loop.state().dq - dt * terms.M().ldlt().solve(loop.commands[0].tau_cmd)).norm(), 1e-3);
}

// Dry friction against its differential equation dz/dt = dq - |dq| z / s, integrated in steps of a
// microsecond along the velocities of the run (constant within a period, as the engine's positions say), and
// Stribeck friction from its formula.
TEST(PlantModel, PreslidingFollowsItsEquation) {
  RobotDescription plant = load_robot("fer");
  FrictionLaw law;
  law.viscous = joints({1, 1, 1, 1, 0.2, 0.2, 0.1});
  law.stribeck = joints({0.3, 0.3, 0.3, 0.3, 0.1, 0.1, 0.05});
  law.presliding = {{0.003, joints({1, 1, 1, 1, 0.4, 0.4, 0.3})},
                    {0.03, joints({0.5, 0.5, 0.5, 0.5, 0.2, 0.2, 0.1})}};
  plant.link_friction = law;
  Loop loop(scene_of({arm_that_is(plant)}));
  loop.unwatch();
  ModelTerms terms = true_terms(plant);
  std::vector<JointVector> z(2, joint_constant(7, 0));
  JointVector worst = joint_constant(7, 0), squares = worst, range = worst;
  constexpr int kSteps = 1500, kFine = 1000;
  for (int k = 0; k < kSteps; ++k) {
    const JointVector q = loop.state().q, dq = loop.state().dq;
    terms.update(q, dq);
    loop.commands[0].tau_cmd = sines(k);
    loop.step();
    const JointVector& v = loop.state().dq;
    const JointVector friction = loop.state().tau_J - terms.M() * (v - dq) / dt - terms.c() - terms.g();
    for (int i = 0; i < 7; ++i) {
      double expected =
          law.viscous[i] * v[i] + law.stribeck[i] * std::tanh(v[i] / 0.01) * std::exp(-v[i] * v[i] / 0.09);
      for (std::size_t e = 0; e < 2; ++e) {
        const double s = law.presliding[e].distance;
        for (int fine = 0; fine < kFine; ++fine)
          z[e][i] += dt / kFine * (v[i] - std::abs(v[i]) * z[e][i] / s);
        expected += law.presliding[e].amplitude[i] * z[e][i] / s;
      }
      const double error = std::abs(friction[i] - expected);
      worst[i] = std::max(worst[i], error);
      squares[i] += error * error;
      range[i] = std::max(range[i], std::abs(expected));
    }
  }
  for (int i = 0; i < 7; ++i) {
    EXPECT_GT(range[i], law.presliding[0].amplitude[i]) << i;  // it really slid
    // Light joints reverse within a few periods: only the linearization over such a period differs.
    const bool light = i >= 4;
    EXPECT_LT(std::sqrt(squares[i] / kSteps), (light ? 0.02 : 0.005) * range[i]) << i;
    EXPECT_LT(worst[i], (light ? 0.35 : 0.05) * range[i]) << i;
  }
}

// Far steeper than an explicit step of 1 ms can integrate.
TEST(PlantModel, SteepFrictionStopsLightJointsWithoutReversingThem) {
  RobotDescription plant = load_robot("fer");
  FrictionLaw law;
  law.stribeck = joint_constant(7, 0.5);
  plant.link_friction = law;
  const SceneArm arm = arm_that_is(plant, false);
  Loop loop(scene_of({arm}));
  loop.step();
  JointVector dq = joint_constant(7, 0);
  dq[6] = 0.2;
  set_plant(loop.backend, 0, arm.q_start, dq);
  for (int k = 0; k < 1000; ++k) {
    loop.step();
    ASSERT_GT(loop.state().dq[6], -0.01) << k;
  }
  EXPECT_LT(loop.state().dq.cwiseAbs().maxCoeff(), 1e-3);
}

TEST(PlantModel, TorqueSensorHasGainOffsetAndNoise) {
  RobotDescription plant = load_robot("fer");
  plant.torque_sensor = TorqueSensor{joints({1.02, 0.97, 1.01, 0.99, 1.03, 0.98, 1.05}),
                                     joints({0.3, -0.2, 0.1, 0.4, -0.5, 0.05, 0.02}), 0.2};
  const SceneArm arm = arm_that_is(plant);
  ModelTerms terms = terms_of(arm);
  terms.update(ready(), joint_constant(7, 0));
  const JointVector expected =
      plant.torque_sensor->gain.cwiseProduct(terms.g()) + plant.torque_sensor->offset;
  Loop loop(scene_of({arm}, {.name = "other noise", .noise_tau_nm = 0.01}));
  constexpr int kSteps = 4000;
  JointVector mean = joint_constant(7, 0), squares = mean;
  for (int k = 0; k < kSteps; ++k) {
    loop.step();
    mean += (loop.state().tau_J - expected) / kSteps;
    squares += (loop.state().tau_J - expected).cwiseAbs2() / kSteps;
  }
  EXPECT_LT(mean.cwiseAbs().maxCoeff(), 5 * 0.2 / std::sqrt(kSteps));
  EXPECT_NEAR(std::sqrt(squares.mean()), 0.2, 0.01 * 0.2 * 2);
}

// A delay of 2.3 periods: each command is held for a period, so the motors get 0.3 of the one before in the
// period in which it arrives.
TEST(PlantModel, DelayMayBeAFractionOfAPeriod) {
  for (const double bandwidth : {0.0, 50.0}) {
    RobotDescription plant = load_robot("fer");
    plant.actuation = Actuation{bandwidth, 0.0023};
    Loop loop(scene_of({arm_that_is(plant)},
                       {.name = "slow", .torque_bandwidth_hz = 10, .command_delay_s = 0.005}));
    loop.steps(10);
    loop.commands[0].tau_cmd[0] = 1;
    double tracked = 0;
    for (int k = 1; k <= 30; ++k) {
      loop.step();
      const double requested = k <= 2 ? 0 : k == 3 ? 0.7 : 1;
      tracked = bandwidth == 0 ? requested
                               : requested + (tracked - requested) * std::exp(-2 * M_PI * bandwidth * dt);
      EXPECT_NEAR(loop.state().tau_J_d[0], requested, 1e-12) << k;
      EXPECT_NEAR(loop.state().tau_J[0], tracked, 1e-9) << k;
    }
  }
}

TEST(PlantModel, WholeDelayIsThatOfTheFidelity) {
  RobotDescription plant = load_robot("fer");
  plant.actuation = Actuation{50, 0.003};
  const PlantFidelity fidelity{.name = "slow", .torque_bandwidth_hz = 50, .command_delay_s = 0.003};
  Loop one(scene_of({arm_that_is(plant)})), other(scene_of({arm_named("a")}, fidelity));
  for (int k = 0; k < 300; ++k) {
    one.commands[0].tau_cmd = other.commands[0].tau_cmd = sines(k);
    one.step();
    other.step();
    ASSERT_EQ(one.state().tau_J, other.state().tau_J) << k;
    ASSERT_EQ(one.state().q, other.state().q) << k;
  }
}

// The arm compensates gravity as if its base were level; the first step shows the difference.
TEST(PlantModel, TiltedBaseFallsByTheGravityDifference) {
  RobotDescription plant = load_robot("fer");
  plant.base_tilt = {0.02, -0.03};
  const Pose X_WB = pose(0.3, -0.4, 0.2, 0, 0, 1.1);
  SceneArm arm = arm_that_is(plant);
  arm.X_WB = X_WB;
  const Matrix3 tilt =
      (Eigen::AngleAxisd(-0.03, Vector3::UnitY()) * Eigen::AngleAxisd(0.02, Vector3::UnitX()))
          .toRotationMatrix();
  ModelTerms straight = terms_of(arm),
             tilted = true_terms(plant, true, {X_WB.rotation * tilt, X_WB.position});
  straight.update(ready(), joint_constant(7, 0));
  tilted.update(ready(), joint_constant(7, 0));
  Loop loop(scene_of({arm}));
  loop.step();
  const JointVector expected = dt * tilted.M().ldlt().solve(straight.g() - tilted.g());
  EXPECT_GT(expected.norm(), 1e-3);
  EXPECT_LT((loop.state().dq - expected).norm(), 1e-8);
}

TEST(PlantModel, BothEnginesAgree) {
  RobotDescription plant = heavier(0.92);
  plant.motor_inertia = joints({0.4, 0.4, 0.3, 0.3, 0.1, 0.1, 0.05});
  plant.base_tilt = {0.02, -0.03};
  plant.actuation = Actuation{60, 0.0014};
  plant.torque_sensor = TorqueSensor{joint_constant(7, 1.02), joint_constant(7, 0.1), 0};
  Scene scene = scene_of({arm_that_is(plant)});
  scene.substeps = 20;
  MujocoBackend mujoco(scene, {.pace = Pace::unpaced});
  PinocchioBackend pinocchio(scene);
  std::vector<ArmState> a(1), b(1);
  std::vector<ArmCommand> command(1);
  mujoco.start();
  pinocchio.start();
  for (int k = 0; k < 300; ++k) {
    const ArmSet due = mujoco.wait();
    (void)pinocchio.wait();
    mujoco.read(due, a);
    pinocchio.read(due, b);
    command[0].tau_cmd = sines(k);
    mujoco.write(due, command);
    pinocchio.write(due, command);
  }
  EXPECT_GT((a[0].q - ready()).norm(), 0.02);
  EXPECT_LT((a[0].q - b[0].q).norm(), 1e-3 * (a[0].q - ready()).norm() + 1e-4);
  EXPECT_LT((a[0].tau_J - b[0].tau_J).norm(), 0.02);
}

TEST(PlantModel, ResetClearsFrictionAndDelay) {
  RobotDescription plant = heavier(1.05);
  FrictionLaw law;
  law.presliding = {{0.01, joint_constant(7, 0.5)}};
  plant.link_friction = law;
  plant.actuation = Actuation{40, 0.0017};
  Loop loop(scene_of({arm_that_is(plant)}));
  const auto run = [&] {
    for (int k = 0; k < 200; ++k) {
      loop.commands[0].tau_cmd = sines(k);
      loop.step();
    }
    return loop.state();
  };
  const auto begin = [&] {
    loop.commands[0].tau_cmd.setZero();
    auto answer = loop.backend.request(ResetSimulation{});
    loop.steps(3);
    EXPECT_TRUE(answer.get().success);
  };
  begin();
  const ArmState first = run();
  begin();
  const ArmState second = run();
  EXPECT_EQ(first.q, second.q);
  EXPECT_EQ(first.tau_J, second.tau_J);
}

// --- in scene files ---

std::string refusal(const std::string& text) {
  try {
    (void)parse_scene(text, MULTIPANDA_BINARY_DIR "/s.yaml", Registry::with_builtins());
  } catch (const std::exception& error) {
    return error.what();
  }
  return "accepted";
}

TEST(PlantModel, CanBeNamedByScenes) {
  const RobotDescription nominal = load_robot("fer");
  RobotDescription plant = heavier(1.1);
  plant.name = "true_arm";
  write_robot(plant, nominal, MULTIPANDA_BINARY_DIR "/plant_models/true_arm.yaml");
  const std::string text = "arms:\n  - name: a\n    plant_model: plant_models/true_arm.yaml\n";
  const Scene scene = parse_scene(text, MULTIPANDA_BINARY_DIR "/s.yaml", Registry::with_builtins());
  ModelTerms believed(build_arm_model(scene.arms[0])), real = true_terms(plant);
  believed.update(ready(), joint_constant(7, 0));
  real.update(ready(), joint_constant(7, 0));
  EXPECT_EQ(believed.g(), [&] {
    ModelTerms terms = true_terms(nominal);
    terms.update(ready(), joint_constant(7, 0));
    return JointVector(terms.g());
  }());
  Loop loop(scene);
  loop.step();
  EXPECT_LT((loop.state().dq - dt * real.M().ldlt().solve(believed.g() - real.g())).norm(), 1e-8);

  // As `model` the file also defines the controllers' model: nothing falls.
  const std::string known = "arms:\n  - name: a\n    model: plant_models/true_arm.yaml\n";
  Loop calm(parse_scene(known, MULTIPANDA_BINARY_DIR "/s.yaml", Registry::with_builtins()));
  calm.steps(100);
  EXPECT_LT((calm.state().q - ready()).norm(), 1e-7);

  using testing::AllOf;
  using testing::HasSubstr;
  const std::string arms = "arms:\n  - name: a\n    plant_model: ";
  EXPECT_THAT(refusal(arms + "fera\n"), AllOf(HasSubstr("s.yaml:3"), HasSubstr("fer")));
  EXPECT_THAT(refusal(arms + MULTIPANDA_SOURCE_DIR "/tests/models/ur5e.yaml\n"),
              AllOf(HasSubstr("s.yaml:3"), HasSubstr("6 joints")));
}

}  // namespace
}  // namespace multipanda::plant_model_test
