// An arm on another arm's torso in MuJoCo, against kinematics, weights and inertias that are computed here.
#include <array>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "backends/mujoco/testing/test_scenes.hpp"
#include "backends/mujoco/world.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::carried_arm_test {
namespace {

using namespace test;

const std::string kTorso = std::string(MULTIPANDA_SOURCE_DIR) + "/scene/testing/torso_arm.yaml";
const Pose kMount = pose(-0.02, -0.15, 0.4, 1.0, 0.1, -0.3);  // as in torso_scene

Scene torso_scene(const std::string& mount = "position_m: [-0.02, -0.15, 0.4], rpy_rad: [1.0, 0.1, -0.3]",
                  const std::string& right = "hand: true") {
  return parse_scene(
      "arms:\n  - {name: left, hand: false, model: " + kTorso +
          ", base: {position_m: [0.4, -0.7, 0.2], rpy_rad: [0, 0, 0.9]}, start_rad: [-0.7, 0.3, 0.2, "
          "-0.4, -1.8, 0.2, 1.7, 0.5]}\n  - {name: right, " +
          right + ", base_on: {arm: left, joint: 1, " + mount + "}}\n",
      "s.yaml", Registry::with_builtins());
}

// Poses of link0 to linkN in the base, by the product of the joints' placements.
std::vector<Pose> links(const RobotDescription& robot, const JointVector& q) {
  std::vector<Pose> chain{Pose{}};
  for (std::size_t i = 0; i < robot.joint_count(); ++i) {
    const Pose turn{Eigen::AngleAxisd(q[static_cast<Eigen::Index>(i)], Vector3::UnitZ()).toRotationMatrix(),
                    Vector3::Zero()};
    chain.push_back(chain.back() * robot.joints[i].pose() * turn);
  }
  return chain;
}

Pose body_pose(const World& world, const std::string& name) {
  const int body = mj_name2id(world.model(), mjOBJ_BODY, name.c_str());
  EXPECT_GE(body, 0) << name;
  return {matrix_at(world.data()->xmat + 9 * body), vector_at(world.data()->xpos + 3 * body)};
}

void expect_same(const Pose& found, const Pose& expected) {
  EXPECT_LT((found.position - expected.position).norm(), 1e-9);
  EXPECT_LT((found.rotation - expected.rotation).norm(), 1e-9);
}

// Two arms in random poses, at rest. Contacts and ends of joints are off: a random pose may touch itself.
class CarriedArmInMujoco : public testing::Test {
 protected:
  CarriedArmInMujoco() {
    world_.model()->opt.disableflags |= mjDSBL_CONTACT | mjDSBL_LIMIT;
    for (const auto& arm : scene_.arms) robots_.push_back(load_robot(arm.model));
  }
  void pose_randomly() {
    q_.clear();
    for (std::size_t a = 0; a < 2; ++a) {
      q_.push_back(random_between(robots_[a].limits.q_min, robots_[a].limits.q_max, random_));
      for (std::size_t j = 0; j < robots_[a].joint_count(); ++j)
        world_.data()->qpos[world_.arm(a).qpos[j]] = q_[a][static_cast<Eigen::Index>(j)];
    }
    std::fill_n(world_.data()->qvel, world_.model()->nv, 0.0);
  }
  // Base of the right arm in the world, now.
  Pose X_WB_right() const { return scene_.arms[0].X_WB * links(robots_[0], q_[0])[1] * kMount; }

  Scene scene_ = torso_scene();
  MujocoPlant plant_{scene_};
  World& world_ = plant_.world();
  std::vector<RobotDescription> robots_;
  std::vector<JointVector> q_;
  std::mt19937 random_{7};
};

TEST_F(CarriedArmInMujoco, StartsWhereTheSceneSays) {
  expect_same(body_pose(world_, "right/link0"), scene_.arms[1].X_WB);
  EXPECT_GT((scene_.arms[1].X_WB.position - scene_.arms[0].X_WB.position).norm(), 0.5);
  const Pose X_WF = world_.X_WF(1);
  pose_randomly();
  ASSERT_TRUE(world_.forward());
  EXPECT_GT((world_.X_WF(1).position - X_WF.position).norm(), 0.05);
  ASSERT_TRUE(world_.reset());
  expect_same(world_.X_WF(1), X_WF);
}

TEST_F(CarriedArmInMujoco, IsMovedByTheTorso) {
  for (int k = 0; k < 20; ++k) {
    pose_randomly();
    mj_kinematics(world_.model(), world_.data());
    expect_same(body_pose(world_, "right/link0"), X_WB_right());
    expect_same(world_.X_WF(1), X_WB_right() * links(robots_[1], q_[1]).back() * robots_[1].flange.pose());
    expect_same(world_.X_WF(0),
                scene_.arms[0].X_WB * links(robots_[0], q_[0]).back() * robots_[0].flange.pose());
  }
}

// The torso bears the weight of the other arm without a torque: each arm compensates its own, for the
// direction in which it was mounted.
TEST_F(CarriedArmInMujoco, FloatsIfEachArmCompensatesItsOwnWeight) {
  std::array<ModelTerms, 2> terms{terms_of(scene_.arms[0]), terms_of(scene_.arms[1])};
  double most = 0;
  for (int k = 0; k < 20; ++k) {
    pose_randomly();
    for (std::size_t a = 0; a < 2; ++a) {
      terms[a].update(q_[a], joint_constant(robots_[a].joint_count(), 0));
      most = std::max(most, terms[a].g().cwiseAbs().maxCoeff());
      for (std::size_t j = 0; j < robots_[a].joint_count(); ++j)
        world_.data()->qfrc_applied[world_.arm(a).dof[j]] = terms[a].g()[static_cast<Eigen::Index>(j)];
    }
    ASSERT_TRUE(world_.forward());
    for (int i = 0; i < world_.model()->nv; ++i) EXPECT_NEAR(world_.data()->qacc[i], 0, 1e-6) << i;
  }
  EXPECT_GT(most, 10);
}

// The inertia about the torso's axis: of each body behind it m d^2 + I_zz, by the models' own figures.
TEST_F(CarriedArmInMujoco, TurnsWithTheTorso) {
  for (int k = 0; k < 20; ++k) {
    pose_randomly();
    ASSERT_TRUE(world_.forward());
    const Pose X_WJ = scene_.arms[0].X_WB * links(robots_[0], q_[0])[1];
    double inertia = 0;
    const auto add = [&](const RigidBody& body, const Pose& X_WL) {
      const Vector3 from_axis = X_WL * body.com - X_WJ.position;
      inertia += body.mass * from_axis.head<2>().squaredNorm() +
                 (X_WL.rotation * body.inertia * X_WL.rotation.transpose())(2, 2);
    };
    const auto left = links(robots_[0], q_[0]), right = links(robots_[1], q_[1]);
    for (std::size_t i = 1; i < left.size(); ++i) add(robots_[0].links[i], scene_.arms[0].X_WB * left[i]);
    for (std::size_t i = 0; i < right.size(); ++i) add(robots_[1].links[i], X_WB_right() * right[i]);
    const HandDescription& hand = *robots_[1].hand;
    add(rigid_hand(hand), X_WB_right() * right.back() * robots_[1].flange.pose() * hand.mount.pose());

    const auto nv = static_cast<Eigen::Index>(world_.model()->nv);
    Eigen::MatrixXd M(nv, nv);
    mj_fullM(world_.model(), world_.data(), M.data());
    EXPECT_NEAR(M(world_.arm(0).dof[0], world_.arm(0).dof[0]), inertia, 1e-9 * inertia);
    EXPECT_GT(inertia, 2);
    for (std::size_t a = 0; a < 2; ++a) {
      const JointVector diagonal = world_.joint_inertia(a);
      for (Eigen::Index j = 0; j < diagonal.size(); ++j) {
        const int dof = world_.arm(a).dof[static_cast<std::size_t>(j)];
        EXPECT_DOUBLE_EQ(diagonal[j], M(dof, dof));
      }
    }
  }
}

TEST_F(CarriedArmInMujoco, HasItsOwnBodies) {
  const mjModel* m = world_.model();
  for (int body = 0; body < m->nbody; ++body) {
    const std::string name = mj_id2name(m, mjOBJ_BODY, body);
    const int arm = name.starts_with("left/") ? 0 : name.starts_with("right/") ? 1 : -1;
    EXPECT_EQ(world_.arm_of_body(body), arm) << name;
    const bool tip = name == "left/link8" || name == "right/link7" || name == "right/hand";
    EXPECT_EQ(world_.is_tip(body), tip) << name;
  }
}

// The base is mounted inside the shapes of the link below and of its neighbor: that is no contact.
TEST(CarriedArmOnItsMount, TouchesNothing) {
  MujocoPlant plant(torso_scene("position_m: [0.08, 0.05, 0.34], rpy_rad: [0, 0.2, -1.5708]", "hand: false"));
  World& world = plant.world();
  const auto distance = [&](const std::string& a, const std::string& b) {
    double least = HUGE_VAL;
    const mjModel* m = world.model();
    const auto is_shape_of = [&](int geom, const std::string& name) {
      return m->geom_contype[geom] != 0 && name == mj_id2name(m, mjOBJ_BODY, m->geom_bodyid[geom]);
    };
    for (int i = 0; i < m->ngeom; ++i) {
      for (int j = 0; j < m->ngeom; ++j) {
        if (is_shape_of(i, a) && is_shape_of(j, b))
          least = std::min(least, mj_geomDistance(m, world.data(), i, j, 5, nullptr));
      }
    }
    return least;
  };
  EXPECT_LT(distance("right/link0", "left/link1"), -0.04);
  EXPECT_LT(distance("right/link0", "left/link2"), -0.01);
  EXPECT_LT(distance("right/link1", "left/link1"), -0.04);
  EXPECT_EQ(world.data()->ncon, 0);
}

// Elsewhere the two arms touch as any two arms do.
TEST(CarriedArmOnItsMount, CollidesWithItsCarrier) {
  try {
    MujocoPlant plant(torso_scene("position_m: [0.03, 0.35, 0.5], rpy_rad: [0, 0, 0]", "hand: false"));
    ADD_FAILURE() << "the arms stand inside each other";
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("inside"));
    EXPECT_THAT(error.what(), testing::HasSubstr("right/"));
    EXPECT_THAT(error.what(), testing::HasSubstr("left/"));
  }
}

// What moves with the torso touches what stands still, unlike the base of an arm that stands on it.
TEST(CarriedArmOnItsMount, TouchesFixedObjects) {
  const Scene free = torso_scene();
  const MujocoPlant plant(free);
  for (const std::string part : {"right/link0", "right/link1", "left/link1", "left/link0"}) {
    Scene scene = free;
    const int body = mj_name2id(plant.world().model(), mjOBJ_BODY, part.c_str());
    SceneObject post{.name = "post", .shape = SceneObject::Shape::sphere, .size = Vector3::Constant(0.02)};
    const mjModel* m = plant.world().model();
    for (int geom = 0; geom < m->ngeom; ++geom) {
      if (m->geom_bodyid[geom] == body && m->geom_contype[geom] != 0)
        post.X_WO.position = vector_at(plant.world().data()->geom_xpos + 3 * geom);
    }
    scene.objects.push_back(post);
    try {
      const MujocoPlant inside(scene);
      EXPECT_EQ(part, "left/link0");
    } catch (const std::invalid_argument& error) {
      EXPECT_NE(part, "left/link0") << error.what();
      EXPECT_THAT(error.what(), testing::HasSubstr("post"));
    }
  }
}

// The true base of a carried arm leans relative to its carrier.
TEST(CarriedArmOnItsMount, LeansWithAHiddenTilt) {
  Scene scene = torso_scene();
  RobotDescription leaning = load_robot("fer");
  leaning.base_tilt = Eigen::Vector2d(0.02, -0.03);
  scene.arms[1].plant_robot = std::make_shared<const RobotDescription>(leaning);
  const MujocoPlant plant(scene);
  Pose expected = scene.arms[1].X_WB;
  expected.rotation *= rotation_from_rpy({0.02, -0.03, 0});
  expect_same(body_pose(plant.world(), "right/link0"), expected);
}

// The simulated arms themselves: without commands nothing falls for half a second.
TEST(CarriedArmOnItsMount, StaysWithoutCommands) {
  const Scene scene = torso_scene();
  Loop loop(scene);
  loop.steps(500);
  for (std::size_t a = 0; a < 2; ++a) {
    EXPECT_LT((loop.state(a).q - scene.arms[a].q_start).cwiseAbs().maxCoeff(), 1e-6);
    EXPECT_LT(loop.state(a).dq.cwiseAbs().maxCoeff(), 1e-6);
  }
  // The torso turns: the base of the other arm goes with it.
  JointVector push = joint_constant(8, 0);
  push[0] = 10;
  loop.unwatch();
  loop.lead_to(push);
  const double before = loop.state(0).q[0];
  loop.steps(100);
  EXPECT_GT(loop.state(0).q[0], before);
  const Pose X_WJ = scene.arms[0].X_WB * links(load_robot(kTorso), loop.state(0).q)[1];
  loop.backend.world().forward();
  expect_same(body_pose(loop.backend.world(), "right/link0"), X_WJ * kMount);
}

}  // namespace
}  // namespace multipanda::carried_arm_test
