#include <cstring>

#include <gtest/gtest.h>

#include "backends/mujoco/testing/test_scenes.hpp"

namespace multipanda::contact_test {
namespace {

using namespace test;

SceneObject ball(const std::string& name, const Vector3& p, double diameter, double mass) {
  SceneObject object;
  object.name = name;
  object.shape = SceneObject::Shape::sphere;
  object.size.setConstant(diameter);
  object.X_WO.position = p;
  object.fixed = false;
  object.mass = mass;
  return object;
}

SceneObject table(const Vector3& p, const Vector3& size) {
  SceneObject object;
  object.name = "table";
  object.size = size;
  object.X_WO.position = p;
  return object;
}

// A ball is thrown at the hand from below: the force that the arm exerts on it in a period is its change of
// momentum less its weight; the moment about K is its change of angular momentum about its center plus lever
// times force.
TEST(Contact, TrueWrenchIsTheForceThatStopsABall) {
  for (const Pose& base : {pose(0, 0, 0), pose(0.4, -0.2, 0.1, 0.3, -0.2, 2.0)}) {
    SceneArm arm = arm_named("a", base);
    arm.X_FE = pose(0.02, -0.03, 0.05, 0.4, 0.1, 0.2);
    arm.X_EK = pose(-0.01, 0.02, 0.03, 0, 0.3, 0);
    ModelTerms terms = terms_of(arm);
    terms.set_config({*arm.X_FE, arm.X_EK}, {}, {});
    terms.update(arm.q_start, joint_constant(7, 0));
    const Vector3 below = terms.X_WF() * Vector3(0.01, 0.02, 0.26);
    const Vector3 upwards = -3 * terms.X_WF().rotation.col(2);
    Scene scene = scene_of({arm});
    scene.objects = {ball("ball", below, 0.1, 0.5)};
    Loop loop(scene);
    const mjData* d = loop.backend.world().data();
    const auto dof = loop.backend.world().objects()[0].dof;
    std::copy_n(upwards.data(), 3, loop.backend.world().data()->qvel + dof);
    int touching = 0;
    for (int k = 0; k < 200; ++k) {
      const Vector3 v = Eigen::Map<const Vector3>(d->qvel + dof);
      const Matrix3 R = loop.backend.world().X_WO(0).rotation;
      const Vector3 w = Eigen::Map<const Vector3>(d->qvel + dof + 3);
      const Vector3 c = Eigen::Map<const Vector3>(d->qpos + loop.backend.world().objects()[0].qpos);
      terms.update(loop.state().q, loop.state().dq);
      const Vector3 p_K = terms.X_WK().position;
      loop.step();
      const Vector3 dv = Eigen::Map<const Vector3>(d->qvel + dof) - v;
      const Vector3 dw = R * (Eigen::Map<const Vector3>(d->qvel + dof + 3) - w);
      const auto& F = loop.state().F_K_W_true;
      const Vector3 force = 0.5 * (dv / 0.001 + Vector3(0, 0, 9.81));
      const Vector3 torque = 0.4 * 0.5 * 0.05 * 0.05 * dw / 0.001 + (c - p_K).cross(force);
      ASSERT_TRUE(loop.state().has_contact_truth);
      EXPECT_LT((Vector3(F.force()) - force).norm(), 1e-6 * (1 + force.norm())) << k;
      if (k > 0) {
        EXPECT_LT((Vector3(F.torque()) - torque).norm(), 0.02 * (0.01 + force.norm() * 0.1)) << k;
      }
      if (force.norm() > 0.1) {
        ++touching;
        EXPECT_LT(force.dot(upwards), 0);
      }
    }
    EXPECT_GT(touching, 3);
  }
}

// Pressing on a table at rest: the commanded torque is J^T of the exerted force, which points down.
TEST(Contact, PressingForceBalancesTheCommand) {
  for (const Pose& base : {pose(0, 0, 0), pose(0.2, 0.3, 0, 0, 0, 2.2)}) {
    SceneArm arm = arm_named("a", base);
    arm.X_FE = pose(0, 0, 0.1034);
    ModelTerms terms = terms_of(arm);
    terms.set_config({*arm.X_FE, {}}, {}, {});
    terms.update(arm.q_start, joint_constant(7, 0));
    const Vector3 tip = terms.X_WE().position;
    Scene scene = scene_of({arm});
    scene.objects = {table({tip.x(), tip.y(), tip.z() - 0.07}, {0.3, 0.3, 0.1})};
    Loop loop(scene);
    loop.unwatch();  // it hits the table with a law without rate limit
    Vector6 push = Vector6::Zero();
    push[2] = -20;
    for (int k = 0; k < 4000; ++k) {
      terms.update(loop.state().q, loop.state().dq);
      loop.commands[0].tau_cmd = terms.J_V_WE().transpose() * push -
                                 terms.M() * (40 * loop.state().dq + 400 * (loop.state().q - ready()));
      loop.step();
    }
    terms.update(loop.state().q, loop.state().dq);
    EXPECT_LT(loop.state().dq.norm(), 1e-3);  // it creeps along the table
    EXPECT_LT(loop.state().F_K_W_true.force().z(), -5);
    const JointVector balance = terms.J_V_WE().transpose() * loop.state().F_K_W_true.vector;
    EXPECT_LT((balance - loop.commands[0].tau_cmd).cwiseAbs().maxCoeff(), 1e-2);
  }
}

TEST(Contact, StartInsideSomethingIsRefusedByName) {
  const SceneArm arm = arm_named("a");
  ModelTerms terms = terms_of(arm);
  terms.update(arm.q_start, joint_constant(7, 0));
  Scene scene = scene_of({arm});
  scene.objects = {table(terms.X_WF().position, {0.2, 0.2, 0.2})};
  try {
    MujocoBackend backend(scene);
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    const std::string text = error.what();
    EXPECT_NE(text.find("table"), std::string::npos) << text;
    EXPECT_NE(text.find("a/"), std::string::npos) << text;
    EXPECT_NE(text.find("mm"), std::string::npos) << text;
  }
}

std::uint64_t hash_run(const Scene& scene, int steps, std::size_t arm, double amplitude_b) {
  Loop loop(scene);
  std::uint64_t hash = 1469598103934665603u;
  const auto mix = [&](const auto& vector) {
    for (Eigen::Index i = 0; i < vector.size(); ++i) {
      std::uint64_t bits;
      const double value = vector[i];
      std::memcpy(&bits, &value, 8);
      hash = (hash ^ bits) * 1099511628211u;
    }
  };
  for (int k = 0; k < steps; ++k) {
    for (std::size_t a = 0; a < loop.commands.size(); ++a) {
      const double amplitude = a == 1 ? amplitude_b : 3.0;
      const auto& s = loop.state(a);
      loop.commands[a].tau_cmd = 60 * (ready() - s.q) - 0.5 * s.dq;
      for (Eigen::Index j = 0; j < 4; ++j) {
        loop.commands[a].tau_cmd[j] += amplitude * std::sin(0.002 * k * static_cast<double>(j + 1));
      }
    }
    loop.step();
    mix(loop.state(arm).q);
    mix(loop.state(arm).dq);
    mix(loop.state(arm).tau_J);
    mix(loop.state(arm).F_K_W_true.vector);
  }
  return hash;
}

TEST(Contact, SameSeedSameBits) {
  Scene scene = scene_of({arm_named("a"), arm_named("b", pose(0, 1.5, 0))}, PlantFidelity::realistic());
  SceneObject floor = table({0.4, 0, 0}, {1, 1, 0.1});
  scene.objects = {floor, ball("ball", {0.31, 0.02, 1.1}, 0.1, 0.5)};
  const auto first = hash_run(scene, 5000, 0, 3);
  EXPECT_EQ(first, hash_run(scene, 5000, 0, 3));
  scene.seed = 2;
  EXPECT_NE(first, hash_run(scene, 5000, 0, 3));
}

TEST(Contact, ArmsWithoutCommonContactAreIndependent) {
  Scene scene = scene_of({arm_named("a"), arm_named("b", pose(0, 2.5, 0))}, PlantFidelity::realistic());
  scene.objects = {table({3, 0, -0.05}, {1, 1, 0.1}), ball("ball", {3, 0, 0.1}, 0.1, 0.5)};
  EXPECT_EQ(hash_run(scene, 2000, 0, 3), hash_run(scene, 2000, 0, -5));
  EXPECT_NE(hash_run(scene, 2000, 1, 3), hash_run(scene, 2000, 1, -5));
}

// Where bodies and objects are after 0.4 s, in which a ball falls on an arm that holds nothing up.
std::vector<double> positions_after(MujocoPlant plant, int* geoms = nullptr) {
  bool touched = false;
  for (int k = 0; k < 400; ++k) {
    plant.advance();
    touched = touched || plant.arm(0).state().F_K_W_true.force().norm() > 1;
  }
  EXPECT_TRUE(touched);
  const mjModel* m = plant.world().model();
  if (geoms != nullptr) *geoms = static_cast<int>(m->ngeom);
  std::vector<double> all(plant.world().data()->qpos, plant.world().data()->qpos + m->nq);
  for (const double tau : plant.arm(0).state().tau_J) all.push_back(tau);
  return all;
}

Scene ball_on_hand(double height) {
  Scene scene = scene_of({arm_named("a"), arm_named("b", pose(0, 0.6, 0))}, PlantFidelity::realistic());
  scene.objects = {table({0.6, 0.3, 0.1}, {0.5, 1.2, 0.2}), ball("ball", {0.31, 0.01, height}, 0.1, 0.5)};
  return scene;
}

TEST(Contact, WhatOnlyPicturesShowChangesNoBit) {
  const Scene scene = ball_on_hand(0.9);
  int plain = 0, shown = 0;
  EXPECT_EQ(positions_after(MujocoPlant(scene), &plain),
            positions_after(MujocoPlant(scene, {.looks = true}), &shown));
  EXPECT_LT(plain, shown / 3);
}

// MuJoCo compiled the parts with the ball elsewhere, which its model's constants know to the last bits.
TEST(Contact, PartsOfASceneServeEveryStart) {
  Scene scene = ball_on_hand(0.9);
  const PlantParts parts(scene);
  EXPECT_EQ(positions_after(MujocoPlant(scene, parts)), positions_after(MujocoPlant(scene)));
  scene = ball_on_hand(0.87);
  scene.arms[0].q_start[0] = 0.02;
  scene.seed = 7;
  const auto shared = positions_after(MujocoPlant(scene, parts)), own = positions_after(MujocoPlant(scene));
  ASSERT_EQ(shared.size(), own.size());
  for (std::size_t i = 0; i < own.size(); ++i) EXPECT_NEAR(shared[i], own[i], 1e-9) << i;
}

}  // namespace
}  // namespace multipanda::contact_test
