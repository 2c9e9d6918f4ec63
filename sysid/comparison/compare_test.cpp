#include "sysid/comparison/compare.hpp"

#include <cmath>
#include <functional>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "sysid/measured/testing/test_logs.hpp"

namespace multipanda::compare_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using testing::HasSubstr;

// Rests until 1 s, then swings with two frequencies per joint. At time t it shows the task's state at
// t - late.
MeasuredLog task(double late, double duration = 5.0, double step = 0.001) {
  MeasuredLog log;
  log.source = "task";
  const auto N = static_cast<Index>(std::lround(duration / step)) + 1;
  log.t.resize(N);
  log.q.resize(N, 3), log.dq.resize(N, 3), log.tau.resize(N, 3);
  for (Index k = 0; k < N; ++k) {
    log.t[k] = 7.0 + step * static_cast<double>(k);
    const double s = std::max(0.0, step * static_cast<double>(k) - late - 1.0);
    for (Index j = 0; j < 3; ++j) {
      const double w = 2.0 + 0.7 * static_cast<double>(j), v = 3.1 * w;
      // Starts with zero velocity.
      log.q(k, j) = 0.3 * (1 - std::cos(w * s)) + 0.05 * (1 - std::cos(v * s));
      log.dq(k, j) = 0.3 * w * std::sin(w * s) + 0.05 * v * std::sin(v * s);
      log.tau(k, j) = 10 * log.q(k, j) + 2 * log.dq(k, j) + static_cast<double>(j);
    }
  }
  return log;
}

void add_wrench(MeasuredLog& log, double force) {
  log.F_EE = MatrixXd::Zero(log.samples(), 6);
  log.F_EE.col(2).setConstant(force);
}

void add_noise(MatrixXd& values, double size, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0, size);
  values = values.unaryExpr([&](double v) { return v + normal(random); }).eval();
}

Comparison compared(const MeasuredLog& real, const MeasuredLog& sim, const CompareOptions& options = {}) {
  return compare(std::span(&real, 1), std::span(&sim, 1), options);
}

TEST(Compare, ALogDoesNotDifferFromItself) {
  MeasuredLog log = task(0);
  std::mt19937 random(3);
  std::uniform_real_distribution<double> jitter(-3e-4, 3e-4);
  for (Index k = 1; k + 1 < log.samples(); ++k) log.t[k] += jitter(random);
  add_noise(log.dq, 0.02, 4), add_noise(log.tau, 0.3, 5);
  add_wrench(log, -3);
  const Comparison result = compared(log, log);
  EXPECT_EQ(result.pairs[0].lag_s, 0.0);
  EXPECT_NEAR(result.pairs[0].correlation, 1.0, 1e-12);
  EXPECT_EQ(result.pairs[0].aligned_by, "dq");
  for (const char* name : {"q", "dq", "tau", "F_EE", "M_EE"}) {
    EXPECT_EQ(result.at(name).mean(), 0.0) << name;
    EXPECT_EQ(result.at(name).largest(), 0.0) << name;
    EXPECT_EQ(result.at(name).spread(), 0.0) << name;
  }
}

class KnownLag : public testing::TestWithParam<double> {};

// The lag is found to a hundredth of a sample; the remaining error comes from interpolation.
TEST_P(KnownLag, IsFoundBetweenSamplesAndTakenOut) {
  const double lag = GetParam();
  const Comparison result = compared(task(0.0), task(lag));
  EXPECT_NEAR(result.pairs[0].lag_s, lag, 1e-5);
  EXPECT_LT(result.at("q").largest(), 3e-5);
  EXPECT_LT(result.at("dq").largest(), 2.5e-3);  // at its corner: 9 rad/s^2 times 1 ms / 4
  // If the lag is not removed, the error is the distance traveled in that time: the RMS of dq times
  // a small lag.
  CompareOptions options;
  options.lag_s = 0.0;
  if (std::abs(lag) > 0.01 || lag == 0) return;
  const MeasuredLog log = task(0.0);
  const double rms = std::sqrt(log.dq.col(1).squaredNorm() / static_cast<double>(log.samples()));
  EXPECT_NEAR(compared(log, task(lag), options).at("q").axis_mean()[1] / (std::abs(lag) * rms), 1.0, 0.02);
}

INSTANTIATE_TEST_SUITE_P(Lags, KnownLag, testing::Values(0.0, 0.003, 0.0123, 0.4567, -0.0058, -0.25));

// Runs of one timeline keep their stamps: the lag is then a difference between the arms.
TEST(Compare, RunsOfOneTimelineAreComparedAsStamped) {
  MeasuredLog real = task(0.0), sim = task(0.04);
  real.scene_text = "name: a\ntimeline:\n  - {at_s: 1, stop: all}\n";
  sim.scene_text = "name: b\ntimeline: [{at_s: 1, stop: all}]\n";
  auto pair = align(real, sim);
  EXPECT_EQ(pair.aligned_by, "dq");  // a different timeline text: not known to be the same motion
  sim.scene_text = "timeline:\n  - {at_s: 1, stop: all}\nname: b\n";
  pair = align(real, sim);
  EXPECT_EQ(pair.aligned_by, "timeline");
  EXPECT_EQ(pair.lag_s, 0.0);
  EXPECT_NEAR(*pair.measured_lag_s, 0.04, 1e-5);
  sim.t.array() += 0.01;  // the log starts at a later cycle
  EXPECT_NEAR(align(real, sim).lag_s, -0.01, 1e-12);
  AlignOptions options;
  options.trust_timeline = false;
  EXPECT_NEAR(align(real, sim, options).lag_s, 0.04, 1e-5);
}

TEST(Compare, NoiseAndOtherSamplingDoNotAffectTheLag) {
  MeasuredLog real = task(0.0), sim = task(0.0312, 5.0, 0.002);
  add_noise(real.dq, 0.05, 11);
  EXPECT_NEAR(compared(real, sim).pairs[0].lag_s, 0.0312, 1e-4);
}

TEST(Compare, OffsetsAndSinesGiveTheirClosedForms) {
  const MeasuredLog real = task(0);
  MeasuredLog sim = real;
  const Eigen::RowVector3d offset(0.01, -0.02, 0.06);
  sim.q.rowwise() += offset;
  // Whole periods of a sine: RMS A / sqrt(2), largest A.
  for (Index k = 0; k < sim.samples(); ++k)
    sim.tau(k, 2) += 1.5 * std::sin(2 * M_PI * 0.002 * static_cast<double>(k));
  const Comparison result = compared(real, sim);
  const QuantityFigures& q = result.at("q");
  for (Index j = 0; j < 3; ++j) {
    EXPECT_NEAR(q.rmse(0, j), std::abs(offset[j]), 1e-12);
    EXPECT_NEAR(q.max(0, j), std::abs(offset[j]), 1e-12);
  }
  EXPECT_NEAR(q.mean(), 0.03, 1e-12);
  EXPECT_NEAR(q.largest(), 0.06, 1e-12);
  EXPECT_NEAR(result.at("tau").rmse(0, 2), 1.5 / std::sqrt(2), 2e-4);
  EXPECT_NEAR(result.at("tau").max(0, 2), 1.5, 1e-6);
  EXPECT_EQ(result.at("tau").rmse(0, 0), 0.0);
}

TEST(Compare, IndependentNoiseAddsBySquares) {
  MeasuredLog real = task(0), sim = task(0);
  add_noise(real.tau, 0.3, 21), add_noise(sim.tau, 0.4, 22);
  CompareOptions options;
  options.lag_s = 0;
  const auto result = compared(real, sim, options);
  // N = 5001: the RMSE scatters by 1/sqrt(2 N) = 1 %.
  for (Index j = 0; j < 3; ++j) EXPECT_NEAR(result.at("tau").rmse(0, j), 0.5, 0.5 * 0.04);
}

// White noise through a low pass of order 2, twice: its power falls to the fraction of the band that is left,
// here summed over the filter's squared gain 1 / (1 + (f / f_c)^4)^2.
TEST(Compare, ALowPassTakesNoiseAndLeavesMotion) {
  MeasuredLog real = task(0, 20.0), sim = task(0, 20.0);
  add_noise(real.tau, 1.0, 41);
  sim.tau.col(1).array() += 0.5;
  CompareOptions options;
  options.lag_s = 0;
  options.low_pass_hz = 10;
  const auto result = compared(real, sim, options);
  double share = 0;
  for (int i = 0; i < 500; ++i) {
    const double gain = 1 / (1 + std::pow(std::tan(M_PI * i / 1000.0) / std::tan(M_PI * 0.01), 4));
    share += gain * gain / 500;
  }
  EXPECT_NEAR(result.at("tau").rmse(0, 0), std::sqrt(share), 0.15 * std::sqrt(share));
  EXPECT_NEAR(result.at("tau").rmse(0, 1), std::hypot(0.5, std::sqrt(share)), 0.03);
  EXPECT_LT(*result.at("tau").noise_floor(), 0.3);
  EXPECT_EQ(result.at("q").mean(), 0.0);
}

// Before the motion the sensor shows its noise; the mean is not noise.
TEST(Compare, TheNoiseFloorIsThatOfTheFirstRest) {
  MeasuredLog real = task(0);
  add_noise(real.tau, 0.25, 31);
  const auto result = compared(real, task(0));
  EXPECT_NEAR(result.rest_s, 0.92, 0.05);
  EXPECT_NEAR(*result.at("tau").noise_floor(), 0.25, 0.25 * 0.08);
  EXPECT_LT(*result.at("dq").noise_floor(), 1e-3);
  MeasuredLog moving = task(-1.5);
  const auto none = compared(moving, moving);
  EXPECT_EQ(none.rest_s, 0);
  EXPECT_FALSE(none.at("tau").noise_floor());
}

TEST(Compare, RepeatsGiveMeanAndSpread) {
  std::vector<MeasuredLog> real(3, task(0)), sim(3, task(0));
  for (int i = 0; i < 3; ++i) sim[static_cast<std::size_t>(i)].q.array() += 0.01 * (i + 1);
  const Comparison result = compare(real, sim);
  EXPECT_NEAR(result.at("q").mean(), 0.02, 1e-12);
  EXPECT_NEAR(result.at("q").spread(), 0.01, 1e-12);
  EXPECT_NEAR(result.at("q").axis_spread()[2], 0.01, 1e-12);
  EXPECT_NEAR(result.at("q").largest(), 0.03, 1e-12);
  // One simulation against all, and unequal numbers.
  EXPECT_EQ(compare(real, std::span(sim).first(1)).pairs.size(), 3u);
  const auto two = compare(real, std::span(sim).first(2));
  EXPECT_EQ(two.pairs.size(), 2u);
  EXPECT_THAT(two.warnings.at(0), HasSubstr("3 real and 2 simulated"));
  EXPECT_THROW(compare({}, sim), std::invalid_argument);
}

TEST(Compare, WhatALogLacksIsNotAvailable) {
  MeasuredLog real = task(0), sim = task(0);
  add_wrench(sim, 1);
  auto result = compared(real, sim);
  EXPECT_EQ(result.at("F_EE").missing, "missing in the real log");
  EXPECT_EQ(result.at("C_err").missing, "missing in both logs");
  EXPECT_FALSE(to_json(result)["quantities"]["F_EE"]["available"].get<bool>());
  EXPECT_THROW(result.at("force"), std::invalid_argument);
  add_wrench(real, 3);
  // C_err = tau_d - (tau - gravity): 0.5 apart where tau_d is.
  real.gravity = sim.gravity = MatrixXd::Constant(real.samples(), 3, 2.0);
  real.tau_d = sim.tau_d = real.tau;
  sim.tau_d.array() += 0.5;
  result = compared(real, sim);
  EXPECT_EQ(result.at("F_EE").axes, (std::vector<std::string>{"x", "y", "z"}));
  EXPECT_NEAR(result.at("F_EE").mean(), 2.0 / 3, 1e-12);
  EXPECT_NEAR(result.at("C_err").mean(), 0.5, 1e-12);
  EXPECT_NEAR(to_json(result)["quantities"]["F_EE"]["rmse"][2].get<double>(), 2.0, 1e-12);
}

TEST(Compare, AWindowIsOfTheRealLogsTime) {
  MeasuredLog real = task(0), sim = task(0);
  sim.q.middleRows(2000, 1000).array() += 0.1;  // from 2 to 3 s
  CompareOptions options;
  options.lag_s = 0;
  options.window_s = {2.1, 2.9};
  auto result = compared(real, sim, options);
  EXPECT_NEAR(result.at("q").mean(), 0.1, 1e-12);
  EXPECT_NEAR(result.pairs[0].from_s, 2.1, 1e-9);
  EXPECT_NEAR(result.pairs[0].to_s, 2.9, 1e-9);
  options.window_s = {3.5, 4.5};
  EXPECT_EQ(compared(real, sim, options).at("q").mean(), 0.0);
  options.window_s = {5.5, 6};
  try {
    compared(real, sim, options);
    FAIL();
  } catch (const LogRefused& error) {
    EXPECT_THAT(error.what(), testing::AllOf(HasSubstr("window of 5.5 to 6 s"), HasSubstr("0 to 5 s")));
  }
}

TEST(Compare, LogsThatDoNotBelongTogetherAreRefusedOrReported) {
  const MeasuredLog real = task(0);
  MeasuredLog six = task(0);
  six.q.conservativeResize(Eigen::NoChange, 2), six.dq.conservativeResize(Eigen::NoChange, 2);
  EXPECT_THROW(compared(real, six), LogRefused);
  MeasuredLog other = swinging_log(5.0, 3);
  for (Index j = 0; j < 3; ++j) other.dq.col(j) = (static_cast<double>(40 + j) * other.t.array()).sin();
  auto result = compared(real, other);
  EXPECT_EQ(result.pairs[0].aligned_by, "start");
  EXPECT_THAT(result.warnings.at(0), HasSubstr("differ too much"));
  // A press without motion is aligned by what the torques show.
  MeasuredLog press = task(0), late = task(0.02);
  for (MeasuredLog* log : {&press, &late}) log->q.setZero(), log->dq.setZero();
  result = compared(press, late);
  EXPECT_EQ(result.pairs[0].aligned_by, "tau");
  EXPECT_NEAR(result.pairs[0].lag_s, 0.02, 1e-4);
}

TEST(Change, ReportsRatioAndWhetherItIsWorseThanTheSpread) {
  const auto with = [](double error, double scatter) {
    std::vector<MeasuredLog> real(3, task(0)), sim(3, task(0));
    for (int i = 0; i < 3; ++i) sim[static_cast<std::size_t>(i)].q.array() += error + scatter * (i - 1);
    return compare(real, sim);
  };
  const Comparison before = with(0.1, 0.01);
  EXPECT_NEAR(change(before, with(0.04, 0.001))[0].ratio, 0.4, 1e-9);
  EXPECT_NEAR(change(before, with(0.04, 0.001))[0].spread, 0.01, 1e-9);
  EXPECT_FALSE(change(before, with(0.119, 0.01))[0].worse);
  EXPECT_TRUE(change(before, with(0.121, 0.01))[0].worse);
  EXPECT_EQ(change(before, before)[0].ratio, 1.0);
  EXPECT_NEAR(to_json(change(before, with(0.04, 0.001)))["q"]["after"].get<double>(), 0.04, 1e-12);
}

}  // namespace
}  // namespace multipanda::compare_test
