// Fits by batched simulation, on simulated arms with known parameters.
#include "sysid/identification/rollout_fit.hpp"

#include <gtest/gtest.h>

#include "sysid/identification/testing/simulated_log.hpp"

namespace multipanda::rollout_fit_test {
namespace {

using namespace test;

PlantFidelity plant(double delay_s, double hz) {
  PlantFidelity f = PlantFidelity::realistic();
  f.command_delay_s = delay_s;
  f.torque_bandwidth_hz = hz;
  return f;
}

Scene loaded_scene(double delay_s, double hz, std::uint64_t seed) {
  SceneArm arm = arm_named("a");
  arm.load_present = {.mass = 0.5, .p_FC = {0.01, 0.02, 0.09}, .inertia_C = 0.001 * Matrix3::Identity()};
  Scene scene = scene_of({arm}, plant(delay_s, hz));
  scene.seed = seed;
  return scene;
}

// The start is off by a millisecond and by half the bandwidth. The replayed scene has another delay and
// bandwidth, which must have no effect.
TEST(ActuationByRollouts, RecoversDelayAndBandwidth) {
  struct Case {
    double delay_ms, hz;
  };
  for (const Case& c : {Case{0, 30}, Case{1.4, 60}, Case{3, 100}}) {
    const double whole = std::floor(c.delay_ms);
    Scene scene = loaded_scene(0.001 * whole, c.hz, 5);
    const MeasuredLog log = record(
        scene, RichMotion(5), {.duration_s = 6, .dither_nm = 0.5, .part_of_period_late = c.delay_ms - whole});
    ActuationFit start = fit_actuation(std::span(&log, 1), load_robot("fer"));
    const Actuation quick = start.actuation;
    start.actuation.command_delay += 0.001;
    start.actuation.torque_bandwidth_hz *= 0.5;
    scene.plant.command_delay_s = 0;
    int shown = 0;
    const ActuationRollouts fit =
        fit_actuation_by_rollouts(std::span(&log, 1), scene, 0, start,
                                  {.windows = 80, .threads = 2, .progress = [&](const FitProgress& p) {
                                     EXPECT_EQ(p.pass, ++shown);
                                     EXPECT_GT(p.rollouts, 0u);
                                     return true;
                                   }});
    EXPECT_GT(shown, 0);
    EXPECT_TRUE(fit.fit.converged);
    EXPECT_NEAR(1e3 * fit.actuation.command_delay, c.delay_ms, 0.1);
    EXPECT_NEAR(fit.actuation.torque_bandwidth_hz, c.hz, 0.05 * c.hz);
    EXPECT_NEAR(1e3 * fit.actuation.command_delay, 1e3 * quick.command_delay, 0.1);
    EXPECT_LT(fit.fit.half95[0], 0.1);
  }
}

// The payload is missing in the replayed scene: its effect on q and dq must not bias the delay.
TEST(ActuationByRollouts, AWrongMassHasLittleInfluence) {
  Scene scene = loaded_scene(0.001, 50, 6);
  const MeasuredLog log = record(scene, RichMotion(6), {.duration_s = 6, .dither_nm = 0.5});
  const ActuationFit start = fit_actuation(std::span(&log, 1), load_robot("fer"));
  scene.arms[0].load_present = {};
  const ActuationRollouts fit =
      fit_actuation_by_rollouts(std::span(&log, 1), scene, 0, start, {.threads = 2});
  EXPECT_NEAR(1e3 * fit.actuation.command_delay, 1, 0.1);
  EXPECT_NEAR(fit.actuation.torque_bandwidth_hz, 50, 2.5);
}

// Friction with memory beyond the sensor and motors with inertia: the replay takes them from the plant model,
// so that it predicts q and dq up to the effect of noise and start states.
TEST(ActuationByRollouts, ReplaysThePlantModel) {
  auto robot = std::make_shared<RobotDescription>(load_robot("fer"));
  robot->link_friction =
      FrictionLaw{.viscous = JointVector::Constant(7, 1.0),
                  .presliding = {{.distance = 0.01, .amplitude = JointVector::Constant(7, 0.8)}}};
  robot->motor_inertia = JointVector::Constant(7, 0.05);
  Scene scene = loaded_scene(0.002, 40, 8);
  scene.arms[0].plant_robot = robot;
  const MeasuredLog log = record(scene, RichMotion(8), {.duration_s = 6, .dither_nm = 0.5});
  const ActuationFit start = fit_actuation(std::span(&log, 1), *robot);
  const RolloutOptions options{.windows = 60, .threads = 2};
  const ActuationRollouts known = fit_actuation_by_rollouts(std::span(&log, 1), scene, 0, start, options);
  EXPECT_NEAR(1e3 * known.actuation.command_delay, 2, 0.1);
  EXPECT_NEAR(known.actuation.torque_bandwidth_hz, 40, 2);
}

// The replayed scene starts with another stiffness and with the table 1 mm away.
void expect_stiffness(Pressed p, double stiffness, const std::string& what) {
  p.scene.objects[0].contact->stiffness_n_per_m = 5000;
  p.scene.objects[0].X_WO.position += 1e-3 * p.scene.objects[0].X_WO.rotation.col(2);  // inwards
  const SurfaceFit fit = fit_surface(p.log, p.scene, 0, "table", {.windows = 60, .threads = 2});
  EXPECT_NEAR(fit.stiffness, stiffness, 0.05 * stiffness) << what;
  EXPECT_TRUE(fit.fit.converged) << what;
  EXPECT_LT(fit.stiffness_half95, 0.05 * stiffness) << what;
}

TEST(SurfaceByRollouts, RecoversStiffness) {
  for (const double K : {1e3, 1e4, 1e5}) {
    expect_stiffness(press(K, ball(), 0, 11), K, "ball");
  }
  expect_stiffness(press(2e4, pad(), 0.3, 12), 2e4, "pad");
  expect_stiffness(press(3e4, ball(), 0.3, 13), 3e4, "ball, sliding");
}

// An undeclared body of 0.4 kg presses with 4 N more: only the change of force counts.
TEST(SurfaceByRollouts, AnUnknownPayloadHasLittleInfluence) {
  Pressed p = press(1e4, ball(), 0, 14, 0.4);
  p.scene.arms[0].load_present = {};
  expect_stiffness(p, 1e4, "payload");
}

TEST(SurfaceByRollouts, RefusesDataWithoutInformation) {
  const Pressed p = press(1e4, ball(), 0, 15, 0, 0);
  EXPECT_THROW((void)fit_surface(p.log, p.scene, 0, "table"), LogRefused);  // always the same force
  EXPECT_THROW((void)fit_surface(p.log, p.scene, 0, "tabel"), std::invalid_argument);
  Scene far = p.scene;
  far.objects[0].X_WO.position.z() -= 1;
  EXPECT_THROW((void)fit_surface(p.log, far, 0, "table"), LogRefused);  // no contact
  Scene bare = p.scene;
  bare.arms[0].tool_shapes.clear();
  EXPECT_THROW((void)fit_surface(p.log, bare, 0, "table"), std::invalid_argument);
}

}  // namespace
}  // namespace multipanda::rollout_fit_test
