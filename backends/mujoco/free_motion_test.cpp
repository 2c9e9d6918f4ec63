#include <gtest/gtest.h>

#include "backends/mujoco/testing/test_scenes.hpp"

namespace multipanda::free_motion_test {
namespace {

using namespace test;

const std::vector<Pose> kBases{{}, pose(0.3, -0.4, 0.2, 0.7, -0.4, 1.1), pose(-2, 1, 0.5, M_PI, 0.2, 0)};

TEST(FreeMotion, ZeroTorqueLeavesArmsWhereTheyAre) {
  Loop loop(
      scene_of({arm_named("a", kBases[0]), arm_named("b", kBases[1]), arm_named("c", kBases[2], false)}));
  loop.steps(5000);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_LT((loop.state(i).q - ready()).cwiseAbs().maxCoeff(), 1e-9) << i;
    EXPECT_EQ(loop.state(i).mode, ArmMode::move);
  }
}

// One step from a random state: the velocity changes by dt M^-1 (tau - c), with the terms of the controllers'
// model, for any orientation of the base.
TEST(FreeMotion, AcceleratesAsTheModelSays) {
  std::mt19937 random(7);
  for (const Pose& base : kBases) {
    const SceneArm arm = arm_named("a", base, &base != &kBases[2]);
    Loop loop(scene_of({arm}));
    loop.unwatch();
    ModelTerms terms = terms_of(arm);
    const auto& limits = terms.model().limits();
    for (int trial = 0; trial < 30; ++trial) {
      const JointVector q = random_between(limits.q_min, limits.q_max, random);
      const JointVector dq = random_between(-limits.dq_max, limits.dq_max, random);
      loop.commands[0].tau_cmd = random_between(-0.2 * limits.tau_max, 0.2 * limits.tau_max, random);
      set_plant(loop.backend, 0, q, dq);
      terms.update(q, dq);
      loop.step();
      if (loop.backend.world().data()->ncon > 0) continue;  // a pose in which the arm touches itself
      const JointVector expected = dq + 0.001 * terms.M().ldlt().solve(loop.commands[0].tau_cmd - terms.c());
      EXPECT_LT((loop.state().dq - expected).cwiseAbs().maxCoeff(), 1e-7);
      EXPECT_LT((loop.state().q - q - 0.001 * expected).cwiseAbs().maxCoeff(), 1e-9);
      EXPECT_LT((loop.state().tau_J - loop.commands[0].tau_cmd - terms.g()).cwiseAbs().maxCoeff(), 1e-9);
      EXPECT_EQ(loop.state().tau_J_d, loop.commands[0].tau_cmd);
    }
  }
}

TEST(FreeMotion, UndeclaredPayloadPullsAndDeclaredOneDoesNot) {
  SceneArm arm = arm_named("a", kBases[1]);
  arm.load_present = {.mass = 1, .p_FC = {0.01, 0.02, 0.1}, .inertia_C = 0.002 * Matrix3::Identity()};
  ModelTerms bare = terms_of(arm), loaded = terms_of(arm);
  const JointVector zero = joint_constant(7, 0);
  loaded.set_config({}, {}, arm.load_present);
  bare.update(arm.q_start, zero);
  loaded.update(arm.q_start, zero);

  Loop undeclared(scene_of({arm}));
  EXPECT_LT((undeclared.state().tau_J - bare.g()).cwiseAbs().maxCoeff(), 1e-9);
  undeclared.step();
  const JointVector expected = 0.001 * loaded.M().ldlt().solve(bare.g() - loaded.g());
  EXPECT_GT(expected.norm(), 1e-3);
  EXPECT_LT((undeclared.state().dq - expected).norm(), 1e-8);

  arm.load_declared = arm.load_present;
  Loop declared(scene_of({arm}));
  EXPECT_LT((declared.state().tau_J - loaded.g()).cwiseAbs().maxCoeff(), 1e-9);
  declared.steps(2000);
  EXPECT_LT((declared.state().q - arm.q_start).norm(), 1e-9);
}

// Valid declared loads are also valid loads of the plant: points and thin rods have singular inertias.
TEST(FreeMotion, PayloadsWithoutExtentMoveAsTheirModel) {
  const Vector3 along = Vector3(1, 2, -1).normalized();
  for (const Matrix3& inertia : {Matrix3(Matrix3::Zero()), Matrix3(Vector3(0.01, 0, 0.01).asDiagonal()),
                                 Matrix3(0.02 * (Matrix3::Identity() - along * along.transpose()))}) {
    SceneArm arm = arm_named("a", kBases[1]);
    arm.load_present = {.mass = 1.5, .p_FC = {0.02, -0.03, 0.1}, .inertia_C = inertia};
    ModelTerms bare = terms_of(arm), loaded = terms_of(arm);
    loaded.set_config({}, {}, arm.load_present);
    const JointVector zero = joint_constant(7, 0);
    bare.update(arm.q_start, zero);
    loaded.update(arm.q_start, zero);
    Loop loop(scene_of({arm}));
    loop.step();
    const JointVector expected = 0.001 * loaded.M().ldlt().solve(bare.g() - loaded.g());
    EXPECT_GT(expected.norm(), 1e-3);
    EXPECT_LT((loop.state().dq - expected).norm(), 1e-8) << inertia;
  }
}

TEST(FreeMotion, SubstepsKeepThePeriod) {
  Scene scene = scene_of({arm_named("a")});
  scene.substeps = 4;
  Loop loop(scene);
  EXPECT_DOUBLE_EQ(loop.backend.world().model()->opt.timestep, 0.00025);
  JointVector tau = joint_constant(7, 0);
  tau[0] = 2;
  loop.lead_to(tau);
  loop.steps(8);
  EXPECT_DOUBLE_EQ(loop.backend.now().seconds(), 0.010);
  EXPECT_NEAR(loop.backend.world().data()->time, 0.010, 1e-12);
  EXPECT_DOUBLE_EQ(loop.state().tau_J[0], 2);  // joint 1 stands upright: no gravity
}

}  // namespace
}  // namespace multipanda::free_motion_test
