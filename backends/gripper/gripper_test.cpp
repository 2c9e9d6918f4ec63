// Fingers and suction cups that hold things: forces, slip, widths, and the requests to them.
#include <gtest/gtest.h>

#include "backends/mujoco/test_scenes.hpp"

namespace multipanda {
namespace {

using namespace test;

constexpr double kGravity = 9.81;

// An arm that follows a joint reference made from Cartesian velocities of its end effector.
struct Rig {
  explicit Rig(const Scene& scene) : terms(terms_of(scene.arms[0])), loop(scene) {
    const SceneArm& arm = scene.arms[0];
    terms.set_config({arm.X_FE.value_or(Pose{}), {}}, {}, {});
    q_ref = arm.q_start;
  }

  // One period; V_W: of the end effector, about its origin, world axes.
  void step(const Vector6& V_W = Vector6::Zero()) {
    terms.update(q_ref, joint_constant(7, 0));
    const Eigen::MatrixXd J = terms.J_V_WE();
    const JointVector dq_new = J.transpose() * (J * J.transpose()).ldlt().solve(V_W);
    const JointVector ddq_ref = (dq_new - dq_ref) / 0.001;
    dq_ref = dq_new;
    const ArmState& state = loop.state();
    terms.update(state.q, state.dq);
    loop.commands[0].tau_cmd =
        terms.M() * (ddq_ref + 60 * (dq_ref - state.dq) + 900 * (q_ref - state.q)) + terms.c();
    loop.step();
    q_ref += 0.001 * dq_ref;
  }
  void steps(int count, const Vector6& V_W = Vector6::Zero()) {
    for (int i = 0; i < count; ++i) step(V_W);
  }
  // Up by `height` within a second, at rest at both ends.
  void lift(double height) {
    for (int k = 0; k < 1000; ++k) {
      Vector6 V = Vector6::Zero();
      V[2] = height * (1 - std::cos(2 * M_PI * (k + 0.5) / 1000));
      step(V);
    }
  }

  std::future<ArmAnswer> ask(ArmRequest request) { return loop.backend.request(0, std::move(request)); }
  // Runs until the answer is there; at most ten simulated seconds.
  ArmAnswer wait(std::future<ArmAnswer> answer) {
    const auto ready = [&] { return answer.wait_for(std::chrono::seconds(0)) == std::future_status::ready; };
    for (int k = 0; k < 10000 && !ready(); ++k) step();
    // The promise is kept by another thread, shortly after the loop has given the answer.
    if (answer.wait_for(std::chrono::seconds(10)) != std::future_status::ready) return {false, "no answer"};
    return answer.get();
  }
  ArmAnswer run(ArmRequest request) { return wait(ask(std::move(request))); }
  const GripperState& gripper() const { return loop.state().gripper; }
  // Of the same instant as MuJoCo's poses of objects.
  Pose X_WE() const { return loop.backend.world().X_WF(0) * loop.state().frames.X_FE; }
  Pose X_EO() const { return X_WE().inverse() * loop.backend.world().X_WO(1); }

  // Forces of the left and right finger on the box, along the direction of their motion [N].
  std::pair<double, double> squeeze() {
    const World& world = loop.backend.world();
    const mjModel* m = world.model();
    const mjData* d = world.data();
    const Vector3 y = X_WE().rotation.col(1);
    double left = 0, right = 0;
    for (int i = 0; i < d->ncon; ++i) {
      const mjContact& contact = d->contact[i];
      mjtNum f[6];
      mj_contactForce(m, d, i, f);
      const Matrix3 R_CW = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(contact.frame);
      const Vector3 force = R_CW.transpose() * Vector3(f[0], f[1], f[2]);
      for (int g = 0; g < 2; ++g) {
        const std::string body = mj_id2name(m, mjOBJ_BODY, m->geom_bodyid[contact.geom[g]]);
        const double along = (g == 0 ? 1 : -1) * y.dot(force);  // on the box
        if (body == "a/left_finger") left -= along;
        if (body == "a/right_finger") right += along;
      }
    }
    return {left, right};
  }

  ModelTerms terms;
  Loop loop;
  JointVector q_ref, dq_ref = joint_constant(7, 0);
};

SceneObject free_box(const Pose& X_WO, const Vector3& size, double mass) {
  SceneObject box;
  box.name = "box";
  box.size = size;
  box.X_WO = X_WO;
  box.fixed = false;
  box.mass = mass;
  return box;
}

// A box between the open fingers, on a table; `off_center`: along the fingers' motion.
Scene grasp_scene(const Vector3& size = {0.03, 0.04, 0.04}, double mass = 0.3, double off_center = 0,
                  const Pose& X_WB = {}) {
  SceneArm arm = arm_named("a", X_WB);
  arm.model = "fr3";
  arm.movable_fingers = true;
  arm.X_FE = Pose{rotation_from_rpy({0, 0, -M_PI / 4}), {0, 0, 0.1034}};
  ModelTerms terms = terms_of(arm);
  terms.set_config({*arm.X_FE, {}}, {}, {});
  terms.update(arm.q_start, joint_constant(7, 0));
  Scene scene = scene_of({arm});
  const Vector3 center = terms.X_WE() * Vector3(0, off_center, 0);
  scene.objects = {SceneObject{}, free_box({terms.X_WE().rotation, center}, size, mass)};
  SceneObject& table = scene.objects[0];
  table.name = "table";
  table.size = {0.3, 0.3, 0.1};
  table.X_WO.position = center - Vector3(0, 0, 0.5 * size.z() + 0.05);
  return scene;
}

TEST(Fingers, GraspedBoxIsLiftedAndHeldThroughMotion) {
  for (const double force : {15.0, 40.0, 70.0}) {
    Rig rig(grasp_scene());
    rig.steps(200);
    const ArmAnswer answer = rig.run(GripperGrasp{.width = 0.04, .speed = 0.1, .force = force});
    EXPECT_TRUE(answer.success) << answer.reason;
    EXPECT_TRUE(rig.gripper().grasped);
    rig.steps(300);
    const auto [left, right] = rig.squeeze();
    std::printf("force %g: %g %g width %g z %g\n", force, left, right, rig.gripper().width, rig.X_EO().position.z());
    EXPECT_NEAR(left, force, 0.05 * force);
    EXPECT_NEAR(right, force, 0.05 * force);
    rig.lift(0.15);
    rig.steps(500);
    const auto F = rig.loop.state().F_K_W_true.force();
    std::printf("F %g %g %g\n", F[0], F[1], F[2]);
    const Pose X_EO = rig.X_EO();
    std::mt19937 random(static_cast<unsigned>(force));
    std::uniform_real_distribution<double> phase(0, 2 * M_PI);
    Vector6 phases;
    for (auto& p : phases) p = phase(random);
    double slip = 0, turn=0;
    for (int k = 0; k < 4000; ++k) {
      Vector6 V;
      for (Eigen::Index i = 0; i < 6; ++i) {
        V[i] = std::min(1.0, 0.002 * k) * (i < 3 ? 0.15 : 0.4) * std::sin(0.004 * k + phases[i]);
      }
      rig.step(V);
      const Pose now = rig.X_EO();
      slip = std::max(slip, (now.position - X_EO.position).norm());
      turn = std::max(turn, log_rotation(now.rotation * X_EO.rotation.transpose()).norm());
    }
    { const Vector3 s = 1000 * (rig.X_EO().position - X_EO.position); std::printf("end slip %g %g %g\n", s[0], s[1], s[2]); }
    std::printf("slip %g mm, turn %g\n", 1000 * slip, turn);
    EXPECT_LT(slip, 1e-3);
    EXPECT_TRUE(rig.gripper().grasped);
  }
}

}  // namespace
}  // namespace multipanda
