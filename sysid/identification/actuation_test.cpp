// Delay, bandwidth, friction before the sensor and its noise, recovered from what simulated arms record.
#include "sysid/identification/actuation.hpp"

#include <gtest/gtest.h>

#include "sysid/identification/testing/simulated_log.hpp"

namespace multipanda::actuation_test {
namespace {

using namespace test;

PlantFidelity plant(double delay_s, double hz) {
  PlantFidelity f = PlantFidelity::realistic();
  f.command_delay_s = delay_s;
  f.torque_bandwidth_hz = hz;
  return f;
}

// The links differ from the prior and an undeclared body hangs on the flange. Neither affects the motors.
SceneArm loaded_arm() {
  SceneArm arm = arm_named("a");
  arm.load_present = {.mass = 0.8, .p_FC = {0.02, -0.03, 0.08}, .inertia_C = 0.002 * Matrix3::Identity()};
  return arm;
}

MeasuredLog log_of(double delay_s, double hz, const RecordOptions& options, std::uint64_t seed) {
  Scene scene = scene_of({loaded_arm()}, plant(delay_s, hz));
  scene.seed = seed;
  return record(scene, RichMotion(seed), options);
}

// The plant has `scale` times this friction.
RobotDescription prior_with_friction(double scale) {
  RobotDescription prior = load_robot("fer");
  prior.friction->p1 /= scale;
  return prior;
}

TEST(Actuation, RecoversDelayBandwidthFrictionAndNoiseOfRealisticArms) {
  struct Case {
    double delay_ms, hz, scale;
  };
  std::uint64_t seed = 1;
  for (const Case& c : {Case{0, 30, 0.5}, Case{1, 50, 1}, Case{2.4, 70, 1.5}, Case{2.75, 100, 0.8}}) {
    const double whole = std::floor(c.delay_ms);
    const MeasuredLog log =
        log_of(0.001 * whole, c.hz, {.dither_nm = 0.5, .part_of_period_late = c.delay_ms - whole}, ++seed);
    const ActuationFit fit = fit_actuation(std::span(&log, 1), prior_with_friction(c.scale));
    EXPECT_NEAR(1e3 * fit.actuation.command_delay, c.delay_ms, 0.05) << c.delay_ms;
    EXPECT_NEAR(fit.actuation.torque_bandwidth_hz, c.hz, 0.02 * c.hz) << c.hz;
    EXPECT_LT(1e3 * fit.delay_half95, 0.05);
    EXPECT_NEAR(fit.noise, 0.05, 0.0015);
    for (Eigen::Index j = 0; j < 7; ++j) {
      EXPECT_NEAR(fit.friction_scale[j], c.scale, 0.02 * c.scale) << "joint" << j + 1;
      EXPECT_NEAR(fit.offset[j], 0, 0.01);
      EXPECT_NEAR(fit.rms[j], 0.05, 0.003);
    }
    EXPECT_TRUE(fit.warnings.empty()) << fit.warnings[0];
  }
}

// The same arm 24 times with different noise: 95 % of the intervals contain the truth. By the binomial law,
// fewer than 20 of 24 happens once in 500 runs with intervals of the right width, and in more than half of
// the runs with half that width.
TEST(Actuation, IntervalsContainTheTruth) {
  int delay = 0, hz = 0, friction = 0;
  constexpr int kTrials = 24;
  for (std::uint64_t seed = 100; seed < 100 + kTrials; ++seed) {
    const MeasuredLog log = log_of(0.001, 50, {.duration_s = 4, .dither_nm = 0.2}, seed);
    const ActuationFit fit = fit_actuation(std::span(&log, 1), load_robot("fer"));
    delay += std::abs(fit.actuation.command_delay - 0.001) < fit.delay_half95 ? 1 : 0;
    hz += std::abs(fit.actuation.torque_bandwidth_hz - 50) < fit.bandwidth_half95 ? 1 : 0;
    for (Eigen::Index j = 0; j < 7; ++j) {
      friction += std::abs(fit.friction_scale[j] - 1) < fit.friction_scale_half95[j] ? 1 : 0;
    }
    EXPECT_LT(fit.bandwidth_half95, 10);
  }
  EXPECT_GE(delay, 20);
  EXPECT_GE(hz, 20);
  EXPECT_GE(friction, static_cast<int>(0.89 * 7 * kTrials));
}

// Half of the rotors' inertia acts, and the prior knows of none.
// Where it is found, the rest is as without motors.
TEST(Actuation, FindsTheMotorsThatActAndNoOthers) {
  Scene scene = scene_of({loaded_arm()}, plant(0.001, 50));
  scene.arms[0].rotor_hidden = 0.5;
  scene.seed = 21;
  const RobotDescription prior = load_robot("fer");
  const MeasuredLog log = record(scene, RichMotion(21), {.duration_s = 8, .dither_nm = 0.5});
  const ActuationFit fit = fit_actuation(std::span(&log, 1), prior);
  ASSERT_EQ(fit.motor_inertia.size(), 7);
  for (Eigen::Index j = 0; j < 7; ++j) {
    EXPECT_NEAR(fit.motor_inertia[j], 0.5 * prior.rotor_inertia[j], 0.05 * prior.rotor_inertia[j])
        << "joint " << j + 1;
    EXPECT_NEAR(fit.friction_scale[j], 1, 0.05);
  }
  EXPECT_NEAR(1e3 * fit.actuation.command_delay, 1, 0.1);
  EXPECT_NEAR(fit.actuation.torque_bandwidth_hz, 50, 2);
  RobotDescription robot = prior;
  apply(fit, robot);
  EXPECT_EQ(robot.motor_inertia, fit.motor_inertia);

  scene.arms[0].rotor_hidden = 1;
  MeasuredLog hidden = record(scene, RichMotion(21), {.duration_s = 8, .dither_nm = 0.5});
  EXPECT_EQ(fit_actuation(std::span(&hidden, 1), prior).motor_inertia.size(), 0);
  // Nor where gravity is wrong by 1 N m/rad, which looks like inertia in slow motion.
  hidden.gravity += hidden.q;
  const JointVector none = fit_actuation(std::span(&hidden, 1), prior).motor_inertia;
  EXPECT_LT(none.size() == 0 ? 0 : none.maxCoeff(), 0.01);
}

// Without fast commands only the sum of delay and lag is identifiable, and the fit warns of it.
TEST(Actuation, SlowCommandsGiveWideIntervals) {
  const MeasuredLog log = log_of(0.001, 50, {.duration_s = 5}, 7);
  const ActuationFit slow = fit_actuation(std::span(&log, 1), load_robot("fer"));
  const MeasuredLog fast_log = log_of(0.001, 50, {.duration_s = 5, .dither_nm = 0.5}, 7);
  const ActuationFit fast = fit_actuation(std::span(&fast_log, 1), load_robot("fer"));
  EXPECT_GT(slow.delay_half95, 3 * fast.delay_half95);
  EXPECT_LT(std::abs(slow.actuation.command_delay - 0.001), 1.5 * slow.delay_half95);
  const auto total = [](const ActuationFit& f) {
    return f.actuation.command_delay + 1 / (2 * M_PI * f.actuation.torque_bandwidth_hz);
  };
  EXPECT_NEAR(1e3 * total(slow), 1e3 * (0.001 + 1 / (2 * M_PI * 50)), 0.1);
}

TEST(Actuation, PerfectTorqueIsIdentifiedAsPerfect) {
  Scene scene = scene_of({loaded_arm()});
  const MeasuredLog log = record(scene, RichMotion(3), {.duration_s = 4, .dither_nm = 0.5});
  RobotDescription prior = load_robot("fer");
  const ActuationFit fit = fit_actuation(std::span(&log, 1), prior);
  EXPECT_EQ(fit.actuation.torque_bandwidth_hz, 0);
  EXPECT_NEAR(fit.actuation.command_delay, 0, 1e-6);
  EXPECT_LT(fit.friction_scale.cwiseAbs().maxCoeff(), 1e-3);  // `ideal` has no friction
  apply(fit, prior);
  ASSERT_TRUE(prior.actuation);
  EXPECT_LT(prior.friction->p1.maxCoeff(), 2e-3);
  EXPECT_LT(prior.torque_sensor->noise, 1e-3);
}

// A reflex in the log: the arm held itself for a while. Those rows must not count.
TEST(Actuation, RowsThatDoNotFollowAreLeftOutAndCounted) {
  MeasuredLog log = log_of(0.001, 50, {.duration_s = 5, .dither_nm = 0.5}, 9);
  log.tau.middleRows(3000, 600).array() += 15;
  const ActuationFit fit = fit_actuation(std::span(&log, 1), load_robot("fer"));
  EXPECT_NEAR(1e3 * fit.actuation.command_delay, 1, 0.1);
  EXPECT_NEAR(fit.actuation.torque_bandwidth_hz, 50, 2);
  ASSERT_FALSE(fit.warnings.empty());
  EXPECT_NE(fit.warnings[0].find("% of the rows do not follow"), std::string::npos) << fit.warnings[0];
}

TEST(Actuation, RefusesDataWithoutInformation) {
  const auto refusal = [](MeasuredLog log) {
    try {
      (void)fit_actuation(std::span(&log, 1), load_robot("fer"));
    } catch (const LogRefused& error) {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  const MeasuredLog log = log_of(0.001, 50, {.duration_s = 1}, 1);
  MeasuredLog bad = log;
  bad.tau_cmd.resize(0, 0);
  EXPECT_NE(refusal(bad).find("tau_cmd"), std::string::npos) << refusal(bad);
  bad = log;
  bad.gravity.resize(0, 0);
  EXPECT_NE(refusal(bad).find("gravity"), std::string::npos) << refusal(bad);
  bad = log;
  for (Eigen::Index k = 0; k < bad.t.size(); ++k) bad.t[k] += 0.05 * std::floor(static_cast<double>(k) / 100);
  EXPECT_NE(refusal(bad).find("without a gap"), std::string::npos) << refusal(bad);
  bad = log;
  bad.q.conservativeResize(Eigen::NoChange, 6);
  EXPECT_NE(refusal(bad).find("6 joints"), std::string::npos) << refusal(bad);
}

}  // namespace
}  // namespace multipanda::actuation_test
