#include "core/trajectory/joint_motion.hpp"

#include <cmath>
#include <random>
#include <stdexcept>

#include <gtest/gtest.h>

namespace multipanda::joint_motion_test {
namespace {

using Random = std::mt19937_64;

double uniform(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}

JointVector vector_in(Random& random, Eigen::Index n, double low, double high) {
  JointVector v(n);
  for (auto& x : v) x = uniform(random, low, high);
  return v;
}

JointMotionLimits limits_in(Random& random, Eigen::Index n) {
  return {vector_in(random, n, 0.5, 2.5), vector_in(random, n, 2, 15), vector_in(random, n, 50, 5000)};
}

JointSample resting(const JointVector& q) {
  return {q, JointVector::Zero(q.size()), JointVector::Zero(q.size())};
}

// Peaks of a motion from differences of its positions alone, per joint as fractions of the limits.
struct Seen {
  double velocity = 0, acceleration = 0, jerk = 0;
  double velocity_error = 0, acceleration_error = 0;  // errors of the motion's own derivatives, absolute
};

Seen look(const JointMotion& motion, const JointMotionLimits& limits, double scale) {
  const double h = 2e-4;
  Seen seen;
  const auto q = [&](double t) { return motion.sample(t).position; };
  for (double t = 2 * h; t < motion.duration() - 2 * h; t += 5 * h) {
    const JointVector a = q(t - 2 * h), b = q(t - h), c = q(t), d = q(t + h), e = q(t + 2 * h);
    const JointVector velocity = (d - b) / (2 * h), acceleration = (d - 2 * c + b) / (h * h),
                      jerk = (e - 2 * d + 2 * b - a) / (2 * h * h * h);
    const JointSample said = motion.sample(t);
    const auto worst = [](const JointVector& v) { return v.cwiseAbs().maxCoeff(); };
    seen.velocity = std::max(seen.velocity, worst(velocity.cwiseQuotient(scale * limits.velocity)));
    seen.acceleration =
        std::max(seen.acceleration, worst(acceleration.cwiseQuotient(scale * limits.acceleration)));
    seen.jerk = std::max(seen.jerk, worst(jerk.cwiseQuotient(scale * limits.jerk)));
    seen.velocity_error = std::max(seen.velocity_error, worst(velocity - said.velocity));
    seen.acceleration_error = std::max(seen.acceleration_error,
                                       worst((acceleration - said.acceleration).cwiseQuotient(limits.jerk)));
  }
  return seen;
}

TEST(JointViaMotion, KeepsItsLimitsUsesThemAndPassesEveryPointInside) {
  Random random(7);
  for (int trial = 0; trial < 60; ++trial) {
    const auto n = std::uniform_int_distribution<Eigen::Index>(1, 8)(random);
    const JointMotionLimits limits = limits_in(random, n);
    const double scale = trial % 3 == 0 ? 1 : uniform(random, 0.1, 1);
    const JointVector start = vector_in(random, n, -2, 2);
    std::vector<JointVector> via;
    const int count = std::uniform_int_distribution<int>(1, 7)(random);
    for (int k = 0; k < count; ++k) via.push_back(vector_in(random, n, -2, 2) * (trial % 4 == 1 ? 0.02 : 1));
    const JointMotion motion = joint_via_motion(resting(start), via, limits, scale);
    const Seen seen = look(motion, limits, scale);
    EXPECT_LE(seen.velocity, 1.0005);
    EXPECT_LE(seen.acceleration, 1.002);
    EXPECT_LE(seen.jerk, 1.02);  // differences of differences
    EXPECT_GE(std::max({seen.velocity, seen.acceleration, seen.jerk}), 0.93);
    EXPECT_LE(seen.velocity_error, 2e-3);
    // The acceleration changes by no more than the jerk limit allows, so it has no jump.
    EXPECT_LE(seen.acceleration_error, 2e-3);

    // The motion meets its start, its end and all points, and each joint stays between successive points.
    EXPECT_EQ(motion.sample(0).position, start);
    EXPECT_LT((motion.sample(motion.duration()).position - via.back()).norm(), 1e-9);
    EXPECT_LT(motion.sample(motion.duration() - 1e-9).velocity.norm(), 1e-6);
    EXPECT_EQ(motion.sample(motion.duration() + 1).velocity.norm(), 0);
    ASSERT_EQ(motion.knots().size(), via.size());
    double before = 0, stops = 0;
    JointVector last = start;
    for (std::size_t k = 0; k < via.size(); ++k) {
      const double at = motion.knots()[k];
      EXPECT_LT((motion.sample(at).position - via[k]).norm(), 1e-9);
      for (int i = 0; i <= 50; ++i) {
        const JointVector q = motion.sample(before + (at - before) * i / 50).position;
        EXPECT_TRUE(((q - last.cwiseMin(via[k])).array() > -1e-9).all());
        EXPECT_TRUE(((last.cwiseMax(via[k]) - q).array() > -1e-9).all());
      }
      stops += joint_via_motion(resting(last), {&via[k], 1}, limits, scale).duration();
      before = at;
      last = via[k];
    }
    EXPECT_LE(motion.duration(), stops * (1 + 1e-9));  // never slower than with a stop at every point
    EXPECT_EQ(motion.knots().back(), motion.duration());

    // The exact extremes agree with the sampled ones.
    const JointPeaks peaks = motion.peaks();
    EXPECT_NEAR(peaks.velocity.cwiseQuotient(scale * limits.velocity).maxCoeff(), seen.velocity, 2e-3);
    EXPECT_LE(peaks.acceleration.cwiseQuotient(scale * limits.acceleration).maxCoeff(), 1 + 1e-9);
    EXPECT_LE(peaks.jerk.cwiseQuotient(scale * limits.jerk).maxCoeff(), 1 + 1e-9);
  }
}

TEST(JointViaMotion, DoesNotStopBetweenPointsInLine) {
  const JointMotionLimits limits{JointVector::Constant(2, 1.0), JointVector::Constant(2, 5.0),
                                 JointVector::Constant(2, 500.0)};
  std::vector<JointVector> via;
  for (int k = 1; k <= 5; ++k) via.push_back(JointVector::Constant(2, 0.4 * k));
  const JointMotion motion = joint_via_motion(resting(JointVector::Zero(2)), via, limits);
  for (std::size_t k = 0; k + 1 < via.size(); ++k)
    EXPECT_GT(motion.sample(motion.knots()[k]).velocity.minCoeff(), 0.5);
  // The time at full speed and the ramps at the ends.
  EXPECT_LT(motion.duration(), 2.0 + 1.0);
}

TEST(JointViaMotion, OnePointTakesTheTimeOfTheClosedForm) {
  const auto duration = [](double distance, double v, double a, double j) {
    const JointMotionLimits limits{JointVector::Constant(1, v), JointVector::Constant(1, a),
                                   JointVector::Constant(1, j)};
    const std::vector<JointVector> via{JointVector::Constant(1, distance)};
    return joint_via_motion(resting(JointVector::Zero(1)), via, limits).duration();
  };
  // s(u) = 10 u^3 - 15 u^4 + 6 u^5: largest s' 15/8, s'' 10/sqrt(3) at u = (1 - 1/sqrt(3)) / 2, s''' 60 at 0.
  EXPECT_NEAR(duration(1.2, 0.5, 100, 1e6), 15.0 / 8 * 1.2 / 0.5, 1e-9);
  EXPECT_NEAR(duration(-1.2, 50, 2, 1e6), std::sqrt(10 / std::sqrt(3.0) * 1.2 / 2), 1e-9);
  EXPECT_NEAR(duration(1.2, 50, 2000, 30), std::cbrt(60 * 1.2 / 30), 1e-9);
  EXPECT_EQ(duration(0, 1, 1, 1), 0);
}

TEST(JointViaMotion, RepeatedPointTakesNoTime) {
  Random random(3);
  const JointMotionLimits limits = limits_in(random, 3);
  const JointVector a = vector_in(random, 3, -1, 1), b = vector_in(random, 3, -1, 1);
  const std::vector<JointVector> once{a, b}, twice{a, a, b, b};
  const JointMotion motion = joint_via_motion(resting(JointVector::Zero(3)), twice, limits);
  EXPECT_NEAR(motion.duration(), joint_via_motion(resting(JointVector::Zero(3)), once, limits).duration(),
              1e-12);
  EXPECT_EQ(motion.knots()[0], motion.knots()[1]);
  EXPECT_EQ(motion.knots()[2], motion.knots()[3]);
}

TEST(JointBrake, StopsWithinLimitsFromAnyState) {
  Random random(11);
  for (int trial = 0; trial < 200; ++trial) {
    const auto n = std::uniform_int_distribution<Eigen::Index>(1, 7)(random);
    const JointMotionLimits limits = limits_in(random, n);
    JointSample from{vector_in(random, n, -2, 2), vector_in(random, n, -1, 1).cwiseProduct(limits.velocity),
                     vector_in(random, n, -1, 1).cwiseProduct(limits.acceleration)};
    if (trial % 5 == 0) from.acceleration *= 1.5;  // beyond the limit, to which the motion returns
    const JointMotion motion = joint_brake(from, limits);
    const JointSample first = motion.sample(0), last = motion.sample(motion.duration() - 1e-9);
    EXPECT_LT((first.position - from.position).norm() + (first.velocity - from.velocity).norm() +
                  (first.acceleration - from.acceleration).norm(),
              1e-12);
    EXPECT_LT(last.velocity.norm(), 1e-5);
    EXPECT_LT(last.acceleration.norm(), 1e-4);
    const JointPeaks peaks = motion.peaks();
    for (Eigen::Index i = 0; i < n; ++i) {
      const double a_0 = std::abs(from.acceleration[i]);
      EXPECT_LE(peaks.acceleration[i], std::max(limits.acceleration[i], a_0) * (1 + 1e-9));
      EXPECT_LE(peaks.jerk[i], limits.jerk[i] * (1 + 1e-9));
      // The speed exceeds the start's only by what the decay of the acceleration makes unavoidable.
      EXPECT_LE(peaks.velocity[i], std::abs(from.velocity[i]) + a_0 * a_0 / (2 * limits.jerk[i]) + 1e-9);
    }
    const Seen seen = look(motion, limits, 1);
    EXPECT_LE(seen.jerk, 1.02);
    EXPECT_LE(seen.velocity_error, 2e-3);
    EXPECT_LE(seen.acceleration_error, 2e-3);
  }
}

TEST(JointBrake, TakesTheTimeOfTheClosedForm) {
  const JointMotionLimits limits{JointVector::Constant(2, 2.0), JointVector::Constant(2, 5.0),
                                 JointVector::Constant(2, 50.0)};
  // Above a^2 / j = 0.5 rad/s the deceleration stays at its limit for a while. Below, it does not
  // reach the limit.
  const auto duration = [&](double v) {
    JointSample from = resting(JointVector::Zero(2));
    from.velocity[1] = v;
    return joint_brake(from, limits).duration();
  };
  EXPECT_NEAR(duration(2), 2.0 / 5 + 5.0 / 50, 1e-9);
  EXPECT_NEAR(duration(-0.2), 2 * std::sqrt(0.2 / 50), 1e-9);
  EXPECT_EQ(duration(0), 0);
}

TEST(JointViaMotion, MovingStartBrakesFirst) {
  Random random(5);
  const JointMotionLimits limits = limits_in(random, 7);
  JointSample from = resting(vector_in(random, 7, -1, 1));
  from.velocity = 0.5 * limits.velocity;
  const std::vector<JointVector> via{vector_in(random, 7, -1, 1), vector_in(random, 7, -1, 1)};
  const JointMotion motion = joint_via_motion(from, via, limits);
  EXPECT_LT((motion.sample(0).velocity - from.velocity).norm(), 1e-12);
  EXPECT_LT((motion.sample(motion.knots()[0]).position - via[0]).norm(), 1e-9);
  const Seen seen = look(motion, limits, 1);
  EXPECT_LE(seen.velocity, 1.001);
  EXPECT_LE(seen.acceleration, 1.002);
  EXPECT_LE(seen.acceleration_error, 2e-3);
}

// A polynomial of degree five and its derivatives, independent of QuinticPiece.
struct Curve {
  double c[6];
  double at(double t, int order) const {
    double value = 0;
    for (int k = order; k < 6; ++k) {
      double factor = c[k] * std::pow(t, k - order);
      for (int m = 0; m < order; ++m) factor *= k - m;
      value += factor;
    }
    return value;
  }
};

JointVector one(double x) { return JointVector::Constant(1, x); }

TEST(JointTrajectory, ReproducesPolynomialsOfItsDegree) {
  const Curve quintic{{0.3, -0.2, 0.7, -1.1, 0.4, 0.2}}, cubic{{0.1, 0.5, -0.4, 0.3, 0, 0}},
      line{{0.2, -0.7, 0, 0, 0, 0}};
  std::vector<TrajectoryPoint> all, velocities, positions;
  for (const double t : {0.0, 0.3, 0.4, 1.1, 2.0}) {
    all.push_back({t, one(quintic.at(t, 0)), one(quintic.at(t, 1)), one(quintic.at(t, 2))});
    velocities.push_back({t, one(cubic.at(t, 0)), one(cubic.at(t, 1)), {}});
    positions.push_back({t, one(line.at(t, 0)), {}, {}});
  }
  const auto check = [](const JointMotion& motion, const Curve& curve) {
    EXPECT_EQ(motion.duration(), 2.0);
    for (double t = 0; t < 2.0; t += 0.013) {
      const JointSample s = motion.sample(t);
      EXPECT_NEAR(s.position[0], curve.at(t, 0), 1e-10);
      EXPECT_NEAR(s.velocity[0], curve.at(t, 1), 1e-9);
      EXPECT_NEAR(s.acceleration[0], curve.at(t, 2), 1e-7);
    }
  };
  check(joint_trajectory(all), quintic);
  check(joint_trajectory(velocities), cubic);
  check(joint_trajectory(positions), line);
  // The same with a separate start in place of the first point.
  const JointSample start{one(quintic.at(0, 0)), one(quintic.at(0, 1)), one(quintic.at(0, 2))};
  const JointMotion moved = joint_trajectory(std::span(all).subspan(1), start);
  check(moved, quintic);
  EXPECT_EQ(moved.knots(), (std::vector<double>{0.3, 0.4, 1.1, 2.0}));
}

TEST(JointTrajectory, ReportsItsPeaks) {
  std::vector<TrajectoryPoint> points{{0, one(0), one(0), one(0)}, {2, one(1), one(0), one(0)}};
  const JointPeaks peaks = joint_trajectory(points).peaks();
  EXPECT_NEAR(peaks.velocity[0], 15.0 / 8 / 2, 1e-9);
  EXPECT_NEAR(peaks.acceleration[0], 10 / std::sqrt(3.0) / 4, 1e-9);
  EXPECT_NEAR(peaks.jerk[0], 60.0 / 8, 1e-9);
  EXPECT_NEAR(peaks.highest[0], 1, 1e-12);
}

template <typename Work>
std::string refusal(Work&& work) {
  try {
    work();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "not refused";
}

TEST(JointMotionRefusals, NameTheExpectedInput) {
  const JointVector q = JointVector::Zero(3);
  const JointMotionLimits limits{JointVector::Ones(3), JointVector::Ones(3), JointVector::Ones(3)};
  const auto expect = [](const std::string& text, const std::string& part) {
    EXPECT_NE(text.find(part), std::string::npos) << text;
  };
  const std::vector<JointVector> good{JointVector::Ones(3)}, narrow{JointVector::Ones(2)},
      wild{JointVector::Constant(3, std::nan(""))};
  expect(refusal([&] { (void)joint_via_motion(resting(q), {}, limits); }), "at least one");
  expect(refusal([&] { (void)joint_via_motion(resting(q), narrow, limits); }), "via point 1: expected 3");
  expect(refusal([&] { (void)joint_via_motion(resting(q), wild, limits); }), "finite");
  expect(refusal([&] { (void)joint_via_motion(resting(q), good, limits, 0); }), "scale");
  expect(refusal([&] { (void)joint_via_motion(resting(q), good, limits, 1.01); }), "scale");
  expect(refusal([&] { (void)joint_via_motion(resting(q), good, limits, std::nan("")); }), "scale");
  JointMotionLimits none = limits;
  none.jerk[1] = 0;
  expect(refusal([&] { (void)joint_brake(resting(q), none); }), "jerk limits: expected values above 0");
  const auto trajectory = [&](std::vector<TrajectoryPoint> points, bool with_start) {
    return refusal(
        [&] { (void)joint_trajectory(points, with_start ? std::optional(resting(q)) : std::nullopt); });
  };
  expect(trajectory({}, true), "at least one point");
  expect(trajectory({{0, q, {}, {}}}, true), "above 0");
  expect(trajectory({{1, q, {}, {}}}, false), "time 0");
  expect(trajectory({{1, q, {}, {}}, {1, q, {}, {}}}, true), "after that of the previous point");
  expect(trajectory({{1, q, {}, {}}, {2, JointVector::Zero(2), {}, {}}}, true),
         "point 2, positions: expected 3");
  expect(trajectory({{1, q, {}, q}}, true), "expected both");
  expect(trajectory({{1, q, wild[0], {}}}, true), "finite");
  expect(trajectory({{1, JointVector(), {}, {}}}, true), "expected positions");
}

}  // namespace
}  // namespace multipanda::joint_motion_test
