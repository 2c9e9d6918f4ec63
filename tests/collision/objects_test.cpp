// Which objects collision avoidance keeps away from, and where: fixed ones, where they are now.
#include <gtest/gtest.h>

#include "backends/mujoco/mujoco_backend.hpp"
#include "core/cycle/control_cycle.hpp"
#include "core/geometry/shape.hpp"
#include "core/modes/registry.hpp"
#include "scene/build.hpp"

namespace multipanda::collision_objects_test {
namespace {

constexpr double kRange = 0.05;         // [m]: the feature's default
constexpr double kNone = 10;            // [m]: the feature's output if nothing is near
constexpr double kPlaced_s = 0.05;      // time of the placement
const Vector3 kFar(0.5, 0, -3);         // under the arm, out of its reach
const Vector3 kBesideHand(0, 0.16, 0);  // from the end effector: no contact
const Vector3 kSize = Vector3::Constant(0.1);

SceneArm arm_at_rest() {
  SceneArm arm;
  arm.name = "left";
  arm.model = "fr3";
  arm.q_start.resize(7);
  arm.q_start << 0, -M_PI / 4, 0, -3 * M_PI / 4, 0, M_PI / 2, M_PI / 4;
  arm.safety = SafetyLimits::of(*build_arm_model(arm));
  return arm;
}

ModelTerms terms_at_start(const SceneArm& arm) {
  ModelTerms terms(build_arm_model(arm));
  const ArmConfig config = arm_config(arm);
  terms.set_config(config.frames, config.tool, config.load);
  terms.update(arm.q_start, joint_constant(7, 0));
  return terms;
}

// The arm at rest beside `shape`, which is far away until the timeline places it beside the hand.
Scene scene_with(ShapeType shape, bool fixed, bool placed) {
  Scene scene;
  scene.arms = {arm_at_rest()};
  scene.controllets = {
      {.name = "law", .type = "joint_impedance", .arms = {0}, .features = {"collision_avoidance"}}};
  scene.active = {"law"};
  const Pose there{Matrix3::Identity(), terms_at_start(scene.arms[0]).X_WE() * Vector3::Zero() + kBesideHand};
  SceneObject object;
  object.name = "object";
  object.shape = shape;
  object.size = kSize;
  object.fixed = fixed;
  object.X_WO = placed ? Pose{Matrix3::Identity(), kFar} : there;
  scene.objects = {object};
  if (placed) {
    TimelineEvent event{.at_s = kPlaced_s, .what = TimelineEvent::What::place};
    event.object = "object";
    event.X_WO = there;
    scene.timeline = {event};
  }
  return scene;
}

// By brute force: the smallest distance of the arm's shapes from the object [m].
double distance_from(const Scene& scene, const JointVector& q, const Pose& X_WO) {
  ModelTerms terms = terms_at_start(scene.arms[0]);
  terms.update(q, joint_constant(7, 0));
  const SceneObject& object = scene.objects[0];
  double smallest = kNone;
  for (const auto& part : terms.model().collision_shapes()) {
    if (!part.scene || part.joint < 0) continue;
    const Pose X_WS = terms.X_WJ(static_cast<std::size_t>(part.joint)) * part.X_JS;
    smallest = std::min(
        smallest, closest_points(part.shape, X_WS, convex_shape(object.shape, object.size), X_WO).distance);
  }
  return smallest;
}

class AvoidingArm {
 public:
  AvoidingArm(const Scene& scene, Backend& backend)
      : registry_(Registry::with_builtins()),
        backend_(backend),
        cycle_(build_cycle_config(scene), registry_, backend) {
    cycle_.modes().activate_at_start(start_set(scene, cycle_.modes()));
    backend_.start();
  }
  void step() { cycle_.step(backend_.wait()); }
  const JointVector& q() const { return cycle_.data().state[0].q; }
  double output(const std::string& name) {
    const Instance& law = cycle_.modes().instance(cycle_.modes().find("law"));
    std::size_t at = 0;
    for (const auto& spec : law.output_specs()) {
      if (spec.name == "collision_avoidance." + name) return law.outputs()[at];
      at += spec.size;
    }
    throw std::logic_error("no output " + name);
  }

 private:
  Registry registry_;
  Backend& backend_;
  ControlCycle cycle_;
};

TEST(Objects, PlacedOnesAreAvoidedWhereTheyAreNow) {
  for (const ShapeType shape : {ShapeType::box, ShapeType::sphere, ShapeType::cylinder, ShapeType::capsule}) {
    const Scene scene = scene_with(shape, true, true);
    MujocoBackend backend(scene, {.pace = Pace::unpaced});
    AvoidingArm arm(scene, backend);
    double closest = kNone;
    for (int k = 0; k < 120; ++k) {
      arm.step();
      const Pose X_WO = backend.world().X_WO(0);
      const bool there = X_WO.position.z() > 0;
      if (std::abs(k - 1000 * kPlaced_s) > 1.5) {
        EXPECT_EQ(there, k > 1000 * kPlaced_s) << k;
      }
      if (k % 8 != 0) continue;  // brute force takes its time
      const double distance = distance_from(scene, arm.q(), X_WO), force = arm.output("largest_force_n");
      if (distance < kRange - 0.005) {
        EXPECT_NEAR(arm.output("smallest_distance_m"), distance, 1e-5) << k;
        EXPECT_GT(force, 1) << k;
      } else if (distance > kRange) {
        EXPECT_EQ(force, 0) << k;
      }
      closest = std::min(closest, distance);
    }
    EXPECT_LT(closest, kRange - 0.01);
    EXPECT_GT(closest, 0.005);

    // A reset brings the object back to where it was at the start.
    auto answer = backend.request(ResetSimulation{});
    for (int k = 0; k < 5; ++k) arm.step();
    EXPECT_TRUE(answer.get().success);
    EXPECT_LT((backend.world().X_WO(0).position - kFar).norm(), 1e-12);
  }
}

// What the simulation places still stands where it was before a real arm.
class BesideRealArms : public MujocoBackend {
 public:
  using MujocoBackend::MujocoBackend;
  Capabilities capabilities(ArmIndex arm) const override {
    Capabilities can = MujocoBackend::capabilities(arm);
    can.simulated = false;
    return can;
  }
};

TEST(Objects, RealArmsAvoidThemWhereTheSceneHasThem) {
  const Scene scene = scene_with(ShapeType::box, true, true);
  BesideRealArms backend(scene, {.pace = Pace::unpaced});
  AvoidingArm arm(scene, backend);
  for (int k = 0; k < 100; ++k) {
    arm.step();
    EXPECT_EQ(arm.output("largest_force_n"), 0) << k;
  }
  EXPECT_GT(backend.world().X_WO(0).position.z(), 0);
}

// Arms handle free objects: they may be touched wherever they are, at the start or later.
TEST(Objects, FreeOnesAreNotAvoided) {
  for (const bool placed : {false, true}) {
    const Scene scene = scene_with(ShapeType::sphere, false, placed);
    MujocoBackend backend(scene, {.pace = Pace::unpaced});
    AvoidingArm arm(scene, backend);
    double closest = kNone;
    for (int k = 0; k < 80; ++k) {
      arm.step();
      if (k % 8 == 0) closest = std::min(closest, distance_from(scene, arm.q(), backend.world().X_WO(0)));
      EXPECT_EQ(arm.output("largest_force_n"), 0) << k;
    }
    EXPECT_LT(closest, kRange - 0.01);  // the feature would act
  }
}

}  // namespace
}  // namespace multipanda::collision_objects_test
