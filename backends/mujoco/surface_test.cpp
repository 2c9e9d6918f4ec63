// Contact in SI units, dry friction, and objects that the timeline moves.
#include <cmath>

#include <gtest/gtest.h>

#include "backends/mujoco/testing/test_scenes.hpp"

namespace multipanda::surface_test {
namespace {

using namespace test;

ToolShape tip_sphere(double diameter = 0.04, double z = 0.2) {
  return {.shape = ShapeType::sphere, .size = Vector3(diameter, 0, 0), .X_FS = pose(0, 0, z)};
}
ToolShape pad(double z = 0.1) {
  return {.shape = ShapeType::box, .size = {0.06, 0.06, 0.02}, .X_FS = pose(0, 0, z)};
}

SceneArm tool_arm(const ToolShape& shape, const Pose& X_WB = {}) {
  SceneArm arm = arm_named("a", X_WB, false);
  arm.tool_shapes = {shape};
  return arm;
}

// Where the base must be for the flange of the ready arm to be at X_WF.
Pose base_for(const Pose& X_WF) {
  ModelTerms terms = terms_of(arm_named("any", {}, false));
  terms.update(ready(), joint_constant(7, 0));
  return X_WF * terms.X_WF().inverse();
}

SceneObject free_object(ShapeType shape, const Vector3& size, double mass, const SurfaceContact& contact) {
  SceneObject object;
  object.name = "object";
  object.shape = shape;
  object.size = size;
  object.fixed = false;
  object.mass = mass;
  object.contact = contact;
  return object;
}

// So heavy that the arm does not move (by more than what is measured and subtracted).
void make_immovable(Loop& loop) {
  mjModel* m = loop.backend.world().model();
  for (std::size_t a = 0; a < loop.backend.world().arm_count(); ++a) {
    for (const int dof : loop.backend.world().arm(a).dof) m->dof_armature[dof] = 1e7;
  }
}

constexpr double kWeight = 4 * 9.81;

// A body of 4 kg lies on a pad that points upwards and does not move. Its weight and a known force push it
// down; the depth gives the contact's stiffness. A flat box rests on four points, a ball on one.
struct Lying {
  Lying(ShapeType shape, const SurfaceContact& contact)
      : thickness(shape == ShapeType::box ? 0.1 : 0.2), loop(scene(shape, thickness, contact)) {
    make_immovable(loop);
  }
  static Scene scene(ShapeType shape, double thickness, const SurfaceContact& contact) {
    const ToolShape wide_pad{.shape = ShapeType::box, .size = {0.16, 0.16, 0.1}, .X_FS = pose(0, 0, 0.06)};
    Scene scene = scene_of({tool_arm(wide_pad, base_for(pose(0, 0, 1)))});
    scene.objects = {free_object(shape, {0.2, 0.2, thickness}, 4.0, contact)};
    scene.objects[0].X_WO.position.z() = 1.11 + 0.5 * thickness;
    return scene;
  }
  void push(double force) {
    loop.backend.world().data()->xfrc_applied[6 * loop.backend.world().objects()[0].body + 2] = -force;
  }
  double depth() {
    loop.backend.world().forward();
    const World& world = loop.backend.world();
    return world.X_WF(0).position.z() + 0.11 + 0.5 * thickness - world.X_WO(0).position.z();
  }
  double settled_depth(double force) {
    push(force);
    loop.steps(4000);
    return depth();
  }
  double thickness;
  Loop loop;
};

TEST(Surface, DepthUnderAKnownForceIsItsStiffness) {
  for (const double K : {1e3, 1e4, 1e5}) {
    for (const ShapeType shape : {ShapeType::box, ShapeType::sphere}) {
      // 4 cm deep, box in box, is beyond what MuJoCo finds contact points for.
      if (K < 1e4 && shape == ShapeType::box) continue;
      const SurfaceContact contact{.stiffness_n_per_m = K, .damping_ratio = 0.8};
      Lying lying(shape, contact);
      const double weight = lying.settled_depth(0), more = lying.settled_depth(30);
      EXPECT_NEAR(weight, kWeight / K, 0.01 * kWeight / K) << K;
      EXPECT_NEAR(more - weight, 30 / K, 0.01 * 30 / K) << K;
      // What the arm exerts: it holds the body up.
      EXPECT_NEAR(lying.loop.state().F_K_W_true.force().z(), kWeight + 30, 1e-3 * kWeight) << K;
    }
  }
}

// Overshoot of a damped oscillator after release: exp(-pi z / sqrt(1 - z^2)). The contact's own inertia adds
// about a tenth to the 4 kg.
TEST(Surface, BodyOf4KgSwingsWithTheDampingRatioGiven) {
  for (const double K : {1e3, 1e4, 1e5}) {
    for (const double ratio : {0.05, 0.3, 0.5}) {
      for (const ShapeType shape : {ShapeType::box, ShapeType::sphere}) {
        if (K < 1e4 && shape == ShapeType::box) continue;
        const SurfaceContact contact{.stiffness_n_per_m = K, .damping_ratio = ratio};
        Lying lying(shape, contact);
        const double rest = lying.settled_depth(0);
        const double pushed = 0.5 * kWeight;  // stays in contact after release
        const double start = lying.settled_depth(pushed) - rest;
        lying.push(0);
        double least = start;
        for (int k = 0; k < 400; ++k) {
          lying.loop.step();
          least = std::min(least, lying.depth() - rest);
        }
        const double decrement = -std::log(-least / start);
        const double measured = decrement / std::hypot(M_PI, decrement);
        EXPECT_NEAR(measured, ratio, 0.1 * ratio + 0.01) << K << " " << (shape == ShapeType::box);
      }
    }
  }
}

// Holds the ready posture, loosely, and presses with `push` (a wrench at E).
void press(Loop& loop, ModelTerms& terms, std::size_t arm, const Vector6& push, const JointVector& q_hold) {
  terms.update(loop.state(arm));
  loop.commands[arm].tau_cmd = terms.J_V_WE().transpose() * push -
                               terms.M() * (40 * loop.state(arm).dq + 400 * (loop.state(arm).q - q_hold));
}

// The moving tool on fixed surfaces. The force is known from the torques at rest, tau = J^T F, the
// penetration from the arm's kinematics: neither comes from MuJoCo's contact.
TEST(Surface, ToolsThatPressSinkInByTheStiffness) {
  for (const Pose& X : {pose(0, 0, 0), pose(0.3, -0.2, 0.4, 0.5, M_PI / 2, 0.7)}) {
    for (const double K : {1e3, 1e4, 1e5}) {
      for (const ToolShape& tool : {tip_sphere(), pad()}) {
        const double reach =
            tool.X_FS.position.z() + 0.5 * (tool.shape == ShapeType::box ? tool.size.z() : tool.size.x());
        SceneArm arm = tool_arm(tool, X);
        arm.X_FE = pose(0, 0, reach);
        Scene scene = scene_of({arm});
        ModelTerms terms = terms_of(arm);
        terms.set_config({*arm.X_FE, {}}, {}, {});
        terms.update(arm.q_start, joint_constant(7, 0));
        const Pose X_WE = terms.X_WE();
        const Vector3 inwards = X_WE.rotation.col(2);
        SceneObject table;
        table.name = "table";
        table.size = {0.3, 0.3, 0.1};
        table.X_WO = {X_WE.rotation, X_WE.position + 0.05 * inwards};
        table.contact = SurfaceContact{.stiffness_n_per_m = K, .damping_ratio = 1};
        table.friction = 0;
        scene.objects = {table};
        Loop loop(scene);
        loop.unwatch();  // raw laws, without any rate limit
        double force[2], depth[2];
        for (int i = 0; i < 2; ++i) {
          Vector6 push = Vector6::Zero();
          push.head<3>() = (i == 0 ? 10 : 40) * inwards;
          for (int k = 0; k < 2500; ++k) {
            press(loop, terms, 0, push, arm.q_start);
            loop.step();
          }
          terms.update(loop.state());
          EXPECT_LT(loop.state().dq.cwiseAbs().maxCoeff(), 1e-3);
          const Jacobian J = terms.J_V_WE();
          const Vector6 F = (J * J.transpose()).ldlt().solve(J * loop.commands[0].tau_cmd);
          force[i] = F.head<3>().dot(inwards);
          depth[i] = (terms.X_WE().position - X_WE.position).dot(inwards);
          EXPECT_LT((loop.state().F_K_W_true.vector - F).norm(), 0.01 * force[i]);
        }
        EXPECT_GT(force[0], 1);
        EXPECT_NEAR(force[1] / depth[1], K, 0.03 * K);
        EXPECT_NEAR((force[1] - force[0]) / (depth[1] - depth[0]), K, 0.03 * K);
      }
    }
  }
}

// At 7 cm/s on a table of friction 0.3, pressed with 10 N: with too much tangential damping contact would be
// lost for a millisecond at a time.
TEST(Surface, SlidingDoesNotChatter) {
  for (const double K : {1e4, 1e5}) {
    SceneArm arm = tool_arm(tip_sphere());
    arm.X_FE = pose(0, 0, 0.22);
    ModelTerms terms = terms_of(arm);
    terms.set_config({*arm.X_FE, {}}, {}, {});
    terms.update(arm.q_start, joint_constant(7, 0));
    const Pose X_WE = terms.X_WE();
    SceneObject table;
    table.name = "table";
    table.size = {0.3, 0.6, 0.1};
    table.X_WO.position = X_WE.position - Vector3(0, 0, 0.05);
    table.friction = 0.3;
    table.contact = SurfaceContact{.stiffness_n_per_m = K};
    Scene scene = scene_of({arm});
    scene.objects = {table};
    Loop loop(scene);
    loop.unwatch();
    int lost = 0, sliding = 0;
    for (int k = 0; k < 3000; ++k) {
      const double t = 0.001 * k, y = k < 1000 ? 0 : 0.07 * (t - 1);
      terms.update(loop.state());
      Vector6 F;
      F.head<3>() = 2000 * (X_WE.position + Vector3(0, y, 0) - terms.X_WE().position);
      F.tail<3>() = -50 * log_rotation(terms.X_WE().rotation * X_WE.rotation.transpose());
      F -= (Vector6() << 60, 60, 60, 3, 3, 3).finished().cwiseProduct(terms.V_WE().vector);
      F[1] += k < 1000 ? 0 : 60 * 0.07;
      F[2] = -10 - 60 * terms.V_WE().linear().z();
      loop.commands[0].tau_cmd = terms.J_V_WE().transpose() * F - 0.3 * loop.state().dq;
      loop.step();
      if (k < 1500) continue;
      const Vector3 seen = loop.state().F_K_W_true.force();
      lost += seen.z() > -5 ? 1 : 0;
      sliding += std::abs(seen.y() + 0.3 * seen.z()) < 0.02 * std::abs(seen.z()) ? 1 : 0;
      EXPECT_NEAR(seen.z(), -10, 1.5);
    }
    EXPECT_EQ(lost, 0) << K;
    EXPECT_GT(sliding, 1400) << K;
    EXPECT_NEAR(terms.V_WE().linear().y(), 0.07, 0.01);
  }
}

// Two tools hold a body of 1 kg between them with 20 N each. Its weight loads the pads: the solver's friction
// slips at f/B_t, and noslip_iterations prevent this.
double slip_of_held_box(std::size_t noslip_iterations) {
  const double gap = 0.11;  // half the box and half a pad
  const Vector3 middle(0, 0, 1);
  Pose X_WL = pose(0, -gap - 0.1, 1, -M_PI / 2), X_WR = pose(0, gap + 0.1, 1, M_PI / 2);
  SceneArm left = tool_arm(pad(), base_for(X_WL)), right = tool_arm(pad(), base_for(X_WR));
  left.name = "left";
  right.name = "right";
  Scene scene = scene_of({left, right});
  scene.noslip_iterations = noslip_iterations;
  scene.objects = {free_object(ShapeType::box, Vector3::Constant(0.2), 1.0,
                               {.stiffness_n_per_m = 1e4, .damping_ratio = 0.5})};
  scene.objects[0].X_WO.position = middle;
  Loop loop(scene);
  loop.unwatch();
  std::vector<ModelTerms> terms;
  for (auto* arm : {&left, &right}) terms.push_back(terms_of(*arm));
  double start = 0;
  for (int k = 0; k < 3500; ++k) {
    for (std::size_t a = 0; a < 2; ++a) {
      terms[a].update(loop.state(a));
      const Pose& X_WF = a == 0 ? X_WL : X_WR;
      Vector6 F;
      F.head<3>() = 4000 * (X_WF.position - terms[a].X_WE().position);
      F[1] = (a == 0 ? 20 : -20);
      F.tail<3>() = -200 * log_rotation(terms[a].X_WE().rotation * X_WF.rotation.transpose());
      F -= (Vector6() << 120, 120, 120, 8, 8, 8).finished().cwiseProduct(terms[a].V_WE().vector);
      loop.commands[a].tau_cmd = terms[a].J_V_WE().transpose() * F - 0.3 * loop.state(a).dq;
    }
    // Supported until the tools have closed.
    if (k < 500) {
      loop.backend.world().data()->xfrc_applied[6 * loop.backend.world().objects()[0].body + 2] = 9.81;
    } else {
      loop.backend.world().data()->xfrc_applied[6 * loop.backend.world().objects()[0].body + 2] = 0;
    }
    loop.step();
    const double height =
        loop.backend.world().X_WO(0).position.z() -
        0.5 * (loop.backend.world().X_WF(0).position.z() + loop.backend.world().X_WF(1).position.z());
    if (k == 500) start = height;
    if (k == 3499) return start - height;
  }
  return 0;
}

TEST(Surface, HeldBoxDoesNotCreepWithNoslip) {
  EXPECT_LT(std::abs(slip_of_held_box(5)), 0.5e-3);
  // Without: 9.81 N over two pads of 100 N s/m, for 3 s.
  EXPECT_GT(slip_of_held_box(0), 0.5 * 3 * 9.81 / 200);
}

// Dry friction holds a joint against 0.25 N m, and of 0.5 N m it leaves 0.2; tau_J, on the links, shows it.
TEST(Stiction, HoldsSmallTorquesAndBelongsToTheLinkSide) {
  const SceneArm arm = arm_named("a", {}, false);
  Loop loop(scene_of({arm}, {.stiction_nm = 0.3}));
  loop.unwatch();
  ModelTerms terms = terms_of(arm);
  loop.commands[0].tau_cmd[0] = 0.25;
  loop.steps(1000);
  EXPECT_LT((loop.state().q - ready()).cwiseAbs().maxCoeff(), 1e-3);
  for (int k = 0; k < 200; ++k) {
    loop.commands[0].tau_cmd = joint_constant(7, 0.0);
    loop.commands[0].tau_cmd[0] = 3.0;
    const JointVector q = loop.state().q, dq = loop.state().dq;
    terms.update(q, dq);
    loop.step();
    const JointVector moved = terms.M() * (loop.state().dq - dq) / 0.001 + terms.c() + terms.g();
    ASSERT_LT((moved - loop.state().tau_J).cwiseAbs().maxCoeff(), 1e-6);
  }
  EXPECT_NEAR(loop.state().tau_J[0], 2.7, 1e-6);
  Loop smooth(scene_of({arm}));
  smooth.unwatch();
  smooth.commands[0].tau_cmd[0] = 0.25;
  smooth.steps(1000);
  EXPECT_GT((smooth.state().q - ready()).cwiseAbs().maxCoeff(), 0.02);
}

// The arm rests on a table that the timeline takes away.
Scene vanishing(double at_s) {
  SceneArm arm = tool_arm(tip_sphere());
  Scene scene = scene_of({arm});
  ModelTerms terms = terms_of(arm);
  terms.update(arm.q_start, joint_constant(7, 0));
  SceneObject table;
  table.name = "table";
  table.size = {0.3, 0.3, 0.1};
  table.X_WO.position = terms.X_WF().position - Vector3(0, 0, 0.22 + 0.05);
  table.contact = SurfaceContact{};
  SceneObject ball = free_object(ShapeType::sphere, Vector3::Constant(0.1), 1, {});
  ball.X_WO.position = table.X_WO.position + Vector3(0.1, 0.1, 0.1);
  scene.objects = {table, ball};
  TimelineEvent away{.at_s = at_s, .what = TimelineEvent::What::place};
  away.object = "table";
  away.X_WO = pose(0, 0, -2);
  TimelineEvent up{.at_s = at_s + 0.1, .what = TimelineEvent::What::place};
  up.object = "object";
  up.X_WO = pose(0, 2, 1);
  scene.timeline = {away, up};
  return scene;
}

TEST(Place, TimelineMovesFixedAndFreeObjectsAtItsTime) {
  const Scene scene = vanishing(0.5);
  Loop loop(scene), again(scene);
  loop.unwatch();
  again.unwatch();
  loop.unwatch();
  ModelTerms terms = terms_of(scene.arms[0]);
  Vector6 push = Vector6::Zero();
  push[2] = -20;
  for (int k = 0; k < 700; ++k) {
    for (Loop* l : {&loop, &again}) {
      press(*l, terms, 0, push, scene.arms[0].q_start);
      l->step();
    }
    ASSERT_EQ(loop.state().q, again.state().q);
    const double force = loop.state().F_K_W_true.force().z();
    if (loop.backend.now().seconds() > 0.3 && loop.backend.now().seconds() < 0.5005) {
      EXPECT_LT(force, -5) << k;
    }
    if (loop.backend.now().seconds() > 0.5005) {
      EXPECT_EQ(force, 0) << k;
    }
  }
  EXPECT_EQ(loop.backend.world().X_WO(0).position, Vector3(0, 0, -2));
  const Vector3 ball = loop.backend.world().X_WO(1).position;
  EXPECT_EQ(ball.y(), 2);
  EXPECT_NEAR(ball.z(), 1 - 0.5 * 9.81 * 0.1 * 0.1, 2e-3);  // it falls from where it was placed

  // A reset restores the table, and past events do not happen again.
  auto answer = loop.backend.request(ResetSimulation{});
  loop.commands[0].tau_cmd.setZero();
  loop.steps(100);
  EXPECT_LT((loop.backend.world().X_WO(0).position - scene.objects[0].X_WO.position).norm(), 1e-12);
  EXPECT_TRUE(answer.get().success);
}

TEST(Place, IntoAnObjectStopsTheWorldWithAReason) {
  Scene scene = vanishing(0.01);
  scene.timeline[0].X_WO = {Matrix3::Identity(), scene.objects[1].X_WO.position};
  Loop loop(scene);
  loop.unwatch();
  for (int k = 0; k < 9; ++k) loop.step();
  EXPECT_FALSE(loop.due.empty());
  for (int k = 0; k < 2; ++k) loop.step();
  EXPECT_TRUE(loop.due.empty());
  EXPECT_NE(loop.backend.fault().find("table"), std::string::npos) << loop.backend.fault();
  scene.timeline[0].object = "tabel";
  EXPECT_THROW(MujocoBackend backend(scene), std::invalid_argument);
}

TEST(ToolShapes, AreSeenInTheWorldAndRefusedInsideThings) {
  Scene scene = vanishing(1);
  const MujocoBackend backend(scene);
  const mjModel* m = backend.world().model();
  const int geom = mj_name2id(m, mjOBJ_GEOM, "a/tool_shape1");
  ASSERT_GE(geom, 0);
  EXPECT_EQ(m->geom_group[geom], 2);  // the group that pictures show
  EXPECT_TRUE(backend.world().is_tip(m->geom_bodyid[geom]));
  EXPECT_EQ(m->body_mass[m->geom_bodyid[geom]], 0);
  scene.objects[0].X_WO.position.z() += 0.01;
  scene.objects[1].X_WO.position.z() += 0.02;
  try {
    MujocoBackend inside(scene);
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("a/tool_shape1"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace multipanda::surface_test
