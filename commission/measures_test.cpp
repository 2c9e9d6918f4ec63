#include "commission/measures.hpp"

#include <cmath>
#include <numbers>
#include <random>

#include <gtest/gtest.h>

#include "arm_interface/arm_settings.hpp"
#include "backends/simulated_arm/friction.hpp"
#include "commission/limits.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::commission {
namespace {

// A known shift, no whole number of samples, a gain and an offset, noise of a torque sensor.
TEST(Lag, FindsAKnownShift) {
  std::mt19937_64 random(31);
  std::normal_distribution<double> noise(0, 0.05);
  for (const double lag : {-0.0041, 0.0, 0.0012, 0.00325, 0.0125}) {
    std::vector<double> x, y;
    for (int k = 0; k < 2000; ++k) {
      const auto wave = [](double t) { return 2 * std::sin(2 * std::numbers::pi * 4 * t); };
      x.push_back(wave(0.001 * k));
      y.push_back(0.9 * wave(0.001 * k - lag) + 0.7 + noise(random));
    }
    const DelayFigures found = lag_of(x, y, 0.001, 0.02);
    EXPECT_NEAR(found.torque_delay_s, lag, 1.5e-4);
    EXPECT_GT(found.fit, 0.99);
  }
}

TEST(Lag, WithoutAMotionNothingIsExplained) {
  const std::vector<double> flat(2000, 1.0);
  EXPECT_LE(lag_of(flat, flat, 0.001, 0.02).fit, 0);
  EXPECT_LT(lag_of({1, 2}, {1, 2}, 0.001, 0.02).fit, 0);
}

// A joint of inertia 1.5 kg m^2 that swings with 0.1 rad/s: dry and viscous friction are between command and
// measurement. One period alone says too little, by far.
TEST(Lag, FrictionIsNoDelay) {
  for (const double delay : {0.0, 0.0035}) {
    for (const double friction : {0.2, 0.9}) {
      const auto swing = [&](double period_s) {
        const double omega = 2 * std::numbers::pi / period_s;
        const auto inertia = [&](double t) { return -1.5 * 0.1 * omega * std::sin(omega * t); };
        std::vector<double> sent, shown;
        for (int k = 0; k < 2000; ++k) {
          const double t = 0.001 * k, v = 0.1 * std::cos(omega * t);
          shown.push_back(inertia(t - delay));
          sent.push_back(inertia(t) + friction * (std::tanh(v / 0.02) + 2 * v));
        }
        return lag_of(sent, shown, 0.001, 0.02);
      };
      const DelayFigures slow = swing(0.25);
      EXPECT_LT(slow.torque_delay_s, delay - 1e-3);
      EXPECT_NEAR(delay_without_friction(slow, swing(0.125)).torque_delay_s, delay, 6e-4);
    }
  }
}

// The twin is a simulated arm: `ideal` has no friction and no delay beyond the period, `realistic` has both.
TEST(Measures, OnSimulatedArms) {
  for (const bool realistic : {false, true}) {
    OpenedScene opened = open_scene("one_arm");
    Scene scene = opened.scene;
    scene.plant = realistic ? PlantFidelity::realistic() : PlantFidelity::ideal();
    ArmsRun run(commission_scene(scene), opened.registry, {.kind = BackendKind::mujoco}, false);
    run.start();
    const auto joints = measure_joint_motion(run, 0);
    EXPECT_GT(joints.moved_rad.minCoeff(), kJointStep_rad - kJointError_rad);
    EXPECT_LT(joints.error_rad.maxCoeff(), kJointError_rad);
    EXPECT_LT(joints.others_rad, kOtherJoint_rad);
    if (!realistic) {
      EXPECT_LT(joints.friction_nm.cwiseAbs().maxCoeff(), 0.02);
    } else {
      // The model's table at the mean speed of a minimum-jerk motion above 70 % of its peak.
      const auto friction = robot_of(scene.arms[0]).friction;
      ASSERT_TRUE(friction.has_value());
      const double v = 0.8965 * kJointSpeed;
      for (std::size_t j = 0; j < 7; ++j) {
        const double both = (friction_torque(*friction, j, v) - friction_torque(*friction, j, -v)) / 2;
        EXPECT_NEAR(joints.friction_nm[static_cast<Eigen::Index>(j)], both, 0.1 * both + 0.005) << j;
      }
    }
    const auto hand = measure_cartesian_motion(run, 0);
    EXPECT_LT(hand.error_m, kCartesianError_m);
    const auto stop = measure_stop(run, 0);
    EXPECT_LT(stop.time_s, kStopTime_s);
    EXPECT_LT(stop.angle_rad, kStopAngle_rad);
    EXPECT_GT(stop.angle_rad, 1e-5);  // it did move
    const auto delay = measure_delay(run, 0);
    EXPECT_GT(delay.fit, 0.9);
    // A command is measured one period later; to that the realistic plant adds a period, and a first-order
    // torque of 50 Hz, computed once per period, whose mean lag is that of a geometric series.
    const double rest = std::exp(-2 * std::numbers::pi * 50 * 0.001);
    EXPECT_NEAR(delay.torque_delay_s, realistic ? 0.002 + 0.001 * rest / (1 - rest) : 0.001,
                realistic ? 3e-4 : 5e-5);
    const auto noise = measure_noise(run, 0, 0.5);
    EXPECT_NEAR(noise.tau_nm.maxCoeff(), realistic ? 0.05 : 0, 0.05);
    run.check();
    run.end();
  }
}

// The tour ends its own stop only: somebody who stops the arm meanwhile has a reason.
TEST(ArmsRun, AStopOfSomebodyElseOutlastsThatOfTheTour) {
  OpenedScene opened = open_scene("one_arm");
  ArmsRun run(commission_scene(opened.scene), opened.registry, {.kind = BackendKind::mujoco}, false);
  run.start();
  for (const bool somebody : {false, true}) {
    run.lead(0, Law::joint);
    run.stop(0);
    (void)run.watch(0.1);
    if (somebody) {
      run.halt();
      (void)run.watch(0.1);
      EXPECT_THROW(run.resume(0), ArmLeft);
      EXPECT_THROW(run.lead(0, Law::joint), ArmLeft);
    } else {
      run.resume(0);
    }
  }
}

TEST(CommissionScene, HasNoThresholdAboveTheCarefulOnes) {
  Scene scene = open_scene("two_arms").scene;
  const SetCollisionThresholds careful = careful_thresholds(*build_arm_model(scene.arms[0]));
  scene.arms[0].collision = careful;
  scene.arms[0].collision->nominal.torque_upper *= 10;
  scene.arms[0].collision->nominal.wrench_upper *= 0.5;
  scene.arms[0].fci = FciConnection{.recover_at_start = true, .keep_collision_thresholds = true};
  scene.arms[1].fci = FciConnection{.keep_collision_thresholds = true};
  const Scene tour = commission_scene(scene);
  EXPECT_EQ(tour.arms[0].collision->nominal.torque_upper, careful.nominal.torque_upper);
  EXPECT_EQ(tour.arms[0].collision->nominal.wrench_upper, Vector6(0.5 * careful.nominal.wrench_upper));
  EXPECT_EQ(tour.arms[1].collision->nominal.torque_upper, careful.nominal.torque_upper);
  EXPECT_FALSE(tour.arms[0].fci->recover_at_start);
  EXPECT_TRUE(tour.active.empty());
  EXPECT_TRUE(tour.timeline.empty());
  EXPECT_LE(tour.contact_bounds.hand_speed, 0.1);
}

}  // namespace
}  // namespace multipanda::commission
