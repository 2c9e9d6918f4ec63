// Accuracy of identification on seeded logs of simulated arms with known parameters: errors of base
// parameters, coverage of the intervals, a payload alone. By default a seeded tenth of the series.
#include <gtest/gtest.h>

#include "core/testing/series.hpp"
#include "sysid/identification/equations.hpp"
#include "sysid/identification/identify.hpp"
#include "sysid/identification/testing/simulated_log.hpp"

namespace multipanda::statistics_test {
namespace {

using namespace test;
using Eigen::Index;
using Eigen::VectorXd;

VectorXd true_values(const LinearFit& fit, const RobotDescription& robot) {
  return fit.base.combination * thetas_of(robot);
}

// Lengths of the base columns along the requested motion.
VectorXd column_lengths(const LinearFit& fit, const RobotDescription& robot, const RichMotion& motion) {
  ArmRegressor regressor(robot);
  VectorXd squares = VectorXd::Zero(fit.base.rank());
  for (double t = 2; t < 18; t += 0.05) {
    const auto [q, dq, ddq] = motion.at(t);
    const Eigen::MatrixXd& Y = regressor.at(q, dq, ddq, {0, 0, -9.81});
    squares += Y(Eigen::all, fit.base.leading).colwise().squaredNorm().transpose();
  }
  return squares.cwiseSqrt();
}

// Steps of 1 ms and the protocol's filter separate these logs from the exact equations.
TEST(IdentificationStatistics, BaseParametersFromMillisecondLogsToOnePercent) {
  const RobotDescription robot = load_robot("fer");
  for (const std::uint64_t seed : {1, 2, 3}) {
    const RichMotion motion(seed);
    const MeasuredLog log = record(scene_of({arm_named("a", {}, false)}), motion, {.duration_s = 20});
    const LinearFit fit = fit_linear(std::span(&log, 1), robot);
    ASSERT_EQ(fit.base.rank(), 43);
    const VectorXd truth = true_values(fit, robot), error = fit.value - truth;
    const VectorXd length = column_lengths(fit, robot, motion);
    EXPECT_LT(error.cwiseProduct(length).norm() / truth.cwiseProduct(length).norm(), 0.01) << seed;
    EXPECT_LT(error.norm() / truth.norm(), 0.01) << seed;
  }
}

// The same motion with different noise: joint friction, torque tracking, delay and noise of `realistic`, so
// that noise reaches the motion through the controller too. Torque is the mean over the period before its
// stamp; the mean of two neighbors belongs to the stamp. Four physics steps per period keep the integrator's
// own error below the noise.
TEST(IdentificationStatistics, IntervalsHoldTheTruthAsOftenAsTheySay) {
  const RobotDescription robot = load_robot("fer");
  const RichMotion motion(1);
  test::Series series;
  const auto inside = [](Index i) { return "inside_" + std::to_string(i); };
  for (int trial = 0; trial < 200; ++trial) {
    if (!series.takes(trial < 20)) continue;
    Scene scene = scene_of({arm_named("a", {}, false)}, PlantFidelity::realistic());
    scene.substeps = 4;
    scene.seed = static_cast<std::uint64_t>(1000 + trial);
    MeasuredLog log = record(scene, motion, {.duration_s = 10});
    const Index last = log.samples() - 1;
    log.tau.topRows(last) = (0.5 * (log.tau.topRows(last) + log.tau.bottomRows(last))).eval();
    const LinearFit fit = fit_linear(std::span(&log, 1), robot);
    const VectorXd error = fit.value - true_values(fit, robot);
    ASSERT_EQ(error.size(), 43);
    for (Index i = 0; i < 43; ++i) series.record(inside(i), std::abs(error[i]) < fit.half95[i]);
    EXPECT_GT(fit.longest_lag, 10);  // the filter alone correlates residuals over 0.1 s
  }
  if (!series.whole()) return;
  double pooled = 0;  // share of the trials
  for (Index i = 0; i < 43; ++i) {
    const double share = series.sum(inside(i)) / static_cast<double>(series.size());
    pooled += share / 43;
    EXPECT_GE(share, series.full() ? 0.89 : 0.7) << "base parameter " << i;
    if (series.full()) {
      EXPECT_LE(share, 0.99) << "base parameter " << i;
    }
  }
  std::printf("pooled: %.1f %% of %zu trials\n", 100 * pooled, series.size());
  EXPECT_NEAR(pooled, 0.95, series.full() ? 0.02 : 0.03);
}

// 30 s on `realistic`: arm and hand are known, the body on the flange is not.
TEST(IdentificationStatistics, PayloadAloneFromThirtySeconds) {
  const RobotDescription robot = load_robot("fer");
  const std::vector<Load> loads{
      {.mass = 0.3, .p_FC = {0, 0, 0.05}, .inertia_C = 3e-4 * Matrix3::Identity()},
      {.mass = 0.8, .p_FC = {0.03, -0.02, 0.08}, .inertia_C = 8e-4 * Matrix3::Identity()},
      {.mass = 1.5, .p_FC = {-0.04, 0.05, 0.03}, .inertia_C = 2e-3 * Matrix3::Identity()}};
  test::Series series;
  for (std::size_t i = 0; i < loads.size(); ++i) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      if (!series.takes(seed == 1)) continue;
      SceneArm arm = arm_named("a");
      arm.load_present = loads[i];
      Scene scene = scene_of({arm}, PlantFidelity::realistic());
      scene.seed = 10 * seed + i;
      const MeasuredLog log = record(scene, RichMotion(scene.seed), {.duration_s = 30});
      const Identification found = identify(std::span(&log, 1), robot, {.payload = true, .hand = true});
      ASSERT_TRUE(found.payload);
      series.record("mass_error_kg", found.payload->mass - loads[i].mass);
      series.record("com_error_m", (found.payload->com - loads[i].p_FC).norm());
      EXPECT_NEAR(found.payload->mass, loads[i].mass, 0.02 * loads[i].mass) << i << " " << seed;
      EXPECT_LT((found.payload->com - loads[i].p_FC).norm(), 0.003) << i << " " << seed;
      EXPECT_TRUE(found.consistent);
      // The intervals are useful: near the error, not far above it.
      EXPECT_LT(found.payload_mass_half95, 0.01 * loads[i].mass);
      EXPECT_LT(found.payload_com_half95, 0.003);
    }
  }
}

}  // namespace
}  // namespace multipanda::statistics_test
