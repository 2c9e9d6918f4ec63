#include "core/state/force_sensor.hpp"

#include <gtest/gtest.h>

#include "backends/mujoco/testing/test_scenes.hpp"
#include "scene/build.hpp"

// What a simulated force sensor measures, against weights and contact forces known in another way.
namespace multipanda::force_sensor_test {
namespace {

using namespace test;

// An arm on a turned base, with a sensor that is turned and off the flange.
SceneArm sensing_arm(bool hand) {
  SceneArm arm = arm_named("a", pose(0.4, -0.2, 0.1, 0.3, -0.2, 2.0), hand);
  arm.force_sensor = SceneForceSensor{.mount = {.X_FS = pose(0.01, -0.02, 0.03, 0.5, 0.2, -0.4)}};
  return arm;
}

JointVector bent() {
  JointVector q = ready();
  q[4] += 0.6;
  q[5] -= 0.9;
  q[6] += 1.0;
  return q;
}

TEST(SimulatedForceSensor, BearsTheWeightOfToolAndPayload) {
  const Load tool{.mass = 1.2, .p_FC = {0.02, -0.01, 0.06}}, payload{.mass = 0.4, .p_FC = {0, 0.03, 0.11}};
  for (const JointVector& q : {ready(), bent()}) {
    SceneArm arm = sensing_arm(false);
    arm.q_start = q;
    arm.tool = tool;
    arm.load_present = arm.load_declared = payload;
    Loop loop(scene_of({arm}));
    loop.steps(20);
    ModelTerms terms = terms_of(arm);
    terms.update(loop.state().q, loop.state().dq);
    const Pose X_WF = terms.X_WF(), X_WS = X_WF * arm.force_sensor->mount.X_FS;
    Vector3 force = Vector3::Zero(), moment = Vector3::Zero();
    for (const Load& load : {tool, payload}) {
      const Vector3 weight(0, 0, -9.81 * load.mass);
      force += weight;
      moment += (X_WF * load.p_FC - X_WS.position).cross(weight);
    }
    const ForceReading& felt = *loop.backend.force_reading(0);
    EXPECT_GT(felt.records, 20u);
    EXPECT_EQ(felt.age_s, 0);
    EXPECT_LT((X_WS.rotation * Vector3(felt.F_S.force()) - force).norm(), 0.01);
    EXPECT_LT((X_WS.rotation * Vector3(felt.F_S.torque()) - moment).norm(), 0.002);
  }
}

// The scene's own mount knows the hand and the tool: tared in one pose, nothing of them shows in another.
TEST(SimulatedForceSensor, ShowsNothingOfHandAndToolInAnyOrientation) {
  SceneArm arm = sensing_arm(true);
  arm.tool = {.mass = 0.5, .p_FC = {0.02, -0.01, 0.06}};
  const ForceSensorMount mount = *build_cycle_config(scene_of({arm})).arms[0].force_sensor;
  EXPECT_NEAR(mount.carried.mass, 0.5 + 0.73, 0.03);  // Franka's hand
  SensedForce knows(mount), ignores({.X_FS = mount.X_FS});
  for (const JointVector& q : {ready(), bent()}) {
    arm.q_start = q;
    Loop loop(scene_of({arm}));
    loop.steps(20);
    ModelTerms terms = terms_of(arm);
    ArmState state = loop.state();
    terms.update(state.q, state.dq);
    const auto seen = [&](SensedForce& sensor) {
      EXPECT_EQ(sensor
                    .update(*loop.backend.force_reading(0),
                            {.X_WF = terms.X_WF(), .p_WK = terms.X_WK().position, .J_V_WK = terms.J_V_WK()},
                            1e-3, state)
                    .rule,
                Intervention::none);
      return state.F_K_W_est.vector.norm();
    };
    EXPECT_LT(seen(knows), 0.02);
    const double ignored = seen(ignores);
    if (q != ready()) {
      EXPECT_GT(ignored, 5);
    }
  }
}

// Pressed on a table: what laws are told is the true contact wrench, about K and in world axes.
TEST(SimulatedForceSensor, OfAHandThatPressesIsTheTrueWrench) {
  SceneArm arm = arm_named("a", pose(0.2, 0.3, 0, 0, 0, 2.2));
  arm.X_FE = pose(0, 0, 0.1034);
  arm.X_EK = pose(0.01, 0.02, -0.03, 0.2, 0, 0.1);
  arm.force_sensor = SceneForceSensor{.mount = {.X_FS = pose(0.01, -0.02, 0.03, 0.5, 0.2, -0.4)}};
  ModelTerms terms = terms_of(arm);
  terms.set_config({*arm.X_FE, arm.X_EK}, {}, {});
  terms.update(arm.q_start, joint_constant(7, 0));
  const Vector3 tip = terms.X_WE().position;
  Scene scene = scene_of({arm});
  SceneObject table;
  table.name = "table";
  table.size = {0.3, 0.3, 0.1};
  table.X_WO.position = tip - Vector3(0, 0, 0.07);
  scene.objects = {table};
  Loop loop(scene);
  loop.unwatch();
  SensedForce sensor(*build_cycle_config(scene).arms[0].force_sensor);
  ArmState state;
  const auto update = [&] {
    state = loop.state();
    terms.update(state.q, state.dq);
    return sensor.update(*loop.backend.force_reading(0),
                         {.X_WF = terms.X_WF(), .p_WK = terms.X_WK().position, .J_V_WK = terms.J_V_WK()},
                         1e-3, state);
  };
  ASSERT_EQ(update().rule, Intervention::none);
  const Vector6 push = (Vector6() << 0, 0, -20, 0, 0, 0).finished();
  for (int k = 0; k < 4000; ++k) {
    (void)update();
    loop.commands[0].tau_cmd =
        terms.J_V_WE().transpose() * push - terms.M() * (40 * state.dq + 400 * (state.q - ready()));
    loop.step();
  }
  ASSERT_EQ(update().rule, Intervention::none);
  EXPECT_LT(state.F_K_W_true.force().z(), -5);
  EXPECT_LT((state.F_K_W_est.force() - state.F_K_W_true.force()).norm(), 0.05);
  EXPECT_LT((state.F_K_W_est.torque() - state.F_K_W_true.torque()).norm(), 0.01);
  const JointVector balance = loop.commands[0].tau_cmd;
  EXPECT_LT((state.tau_ext_hat - balance).cwiseAbs().maxCoeff(), 0.05);
}

}  // namespace
}  // namespace multipanda::force_sensor_test
