// The estimate of a series against the curves and the irregularities from which its samples are made.
#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "core/reference/reference.hpp"
#include "core/testing/test_arm.hpp"

namespace multipanda::series_test {
namespace {

using test::Draw;

constexpr double kPeriod = 0.02;                        // [s]
constexpr double kGreatest = 0.5, kGreatestTurn = 1.0;  // [m/s] or [rad/s], [rad/s]

Target joints_at(const Vector3& q) {
  Target target;
  target.size = 3;
  for (std::size_t i = 0; i < 3; ++i) target.values[i] = q[static_cast<Eigen::Index>(i)];
  return target;
}

Vector3 first_three(const QuinticSegment::Values& v) { return {v[0], v[1], v[2]}; }
Vector3 last_three(const QuinticSegment::Values& v) { return {v[3], v[4], v[5]}; }

// One coordinate that is fed by hand.
struct OneJoint {
  explicit OneJoint(double x = 0) { series.begin(joints_at({x, 0, 0}), false, kGreatest, kGreatestTurn); }
  void add(double x, double dt = kPeriod) { series.add(joints_at({x, 0, 0}), dt, kPeriod); }
  double position() const { return series.at(0, Matrix3::Identity()).position[0]; }
  double velocity() const { return series.at(0, Matrix3::Identity()).velocity[0]; }
  Series series;
};

TEST(Series, OfAParabolaIsExtrapolatedAlongIt) {
  Draw draw(41);
  for (int trial = 0; trial < 10; ++trial) {
    const Vector3 x = draw.vector3(1), v = draw.vector3(0.2), a = draw.vector3(0.1);
    const auto place = [&](double t) -> Vector3 { return x + t * v + 0.5 * t * t * a; };
    Series series;
    series.begin(joints_at(place(0)), false, kGreatest, kGreatestTurn);
    double t = 0;
    for (int k = 0; k < 300; ++k) series.add(joints_at(place(t += kPeriod)), kPeriod, kPeriod);
    for (const double ahead : {0.0, 0.05, 0.3}) {
      const auto s = series.at(ahead, Matrix3::Identity());
      EXPECT_LT((first_three(s.position) - place(t + ahead)).norm(), 1e-6) << ahead;
      EXPECT_LT((first_three(s.velocity) - (v + (t + ahead) * a)).norm(), 1e-6) << ahead;
      EXPECT_LT((first_three(s.acceleration) - a).norm(), 1e-6) << ahead;
    }
  }
}

// A pose that moves along a parabola and turns about a fixed axis, faster and faster. Rates of the rotation
// vector by differences; they are linearized in it, so it is kept small.
TEST(Series, OfAPoseTurnsOnAboutItsAxis) {
  Draw draw(42);
  for (int trial = 0; trial < 10; ++trial) {
    const Vector3 v = draw.vector3(0.2), axis = draw.rotation().col(0);
    const Matrix3 R = draw.rotation();
    const double rate = draw.uniform(0.2, 0.6), growth = draw.uniform(-0.05, 0.05);
    const auto pose = [&](double t) {
      return Pose{exp_rotation((rate * t + 0.5 * growth * t * t) * axis) * R, t * v};
    };
    Series series;
    series.begin(pose_target(pose(0)), true, kGreatest, kGreatestTurn);
    double t = 0;
    for (int k = 0; k < 300; ++k) series.add(pose_target(pose(t += kPeriod)), kPeriod, kPeriod);
    const Matrix3 R_0 = exp_rotation(draw.vector3(0.1)) * pose(t).rotation;
    for (const double ahead : {0.0, 0.03, 0.1}) {
      const auto s = series.at(ahead, R_0);
      EXPECT_LT((first_three(s.position) - pose(t + ahead).position).norm(), 1e-6);
      EXPECT_LT((exp_rotation(last_three(s.position)) * R_0 - pose(t + ahead).rotation).norm(), 1e-6);
      constexpr double h = 1e-4;
      const Vector3 difference =
          (last_three(series.at(ahead + h, R_0).position) - last_three(series.at(ahead - h, R_0).position)) /
          (2 * h);
      EXPECT_LT((last_three(s.velocity) - difference).norm(), 6e-3 * difference.norm()) << ahead;
    }
  }
}

// Samples at equal times whose values are those of times that are wrong by a normal error: that error's mean
// size is (2 / pi)^1/2 of its standard deviation. Whatever the speed.
TEST(Series, UnevennessIsTheMeanErrorInTime) {
  constexpr double kError = 0.1 * kPeriod;
  double at_first_speed = 0;
  for (const double speed : {0.05, 0.1, 0.4}) {
    std::mt19937 engine(43);
    std::normal_distribution<double> error(0, kError);
    OneJoint joint;
    double sum = 0;
    constexpr int kCount = 6000;
    for (int k = 1; k <= kCount + 200; ++k) {
      joint.add(speed * (k * kPeriod + error(engine)));
      if (k > 200) sum += joint.series.unevenness() / kCount;
    }
    EXPECT_NEAR(sum, std::sqrt(2 / std::numbers::pi) * kError, 0.05 * kError) << speed;
    if (at_first_speed == 0) at_first_speed = joint.series.unevenness();
    EXPECT_NEAR(joint.series.unevenness(), at_first_speed, 1e-6 * kError) << speed;
  }
}

// Along and about every axis.
TEST(Series, UnevennessOfAPoseIsTheSameAlongEveryAxis) {
  constexpr double kError = 0.1 * kPeriod;
  for (int axis = 0; axis < 6; ++axis) {
    std::mt19937 engine(47);
    std::normal_distribution<double> error(0, kError);
    Series series;
    series.begin(pose_target(Pose{}), true, kGreatest, kGreatestTurn);
    double sum = 0;
    constexpr int kCount = 3000;
    for (int k = 1; k <= kCount + 200; ++k) {
      const Vector3 way = 0.1 * (k * kPeriod + error(engine)) * Vector3::Unit(axis % 3);
      series.add(
          pose_target(axis < 3 ? Pose{Matrix3::Identity(), way} : Pose{exp_rotation(way), Vector3::Zero()}),
          kPeriod, kPeriod);
      if (k > 200) sum += series.unevenness() / kCount;
    }
    EXPECT_NEAR(sum, std::sqrt(2 / std::numbers::pi) * kError, 0.06 * kError) << axis;
  }
}

TEST(Series, WithTimesOfItsOwnOrAtEqualTimesIsEven) {
  Draw draw(44);
  Series timed, equal;
  for (Series* each : {&timed, &equal}) each->begin(joints_at({0, 0, 0}), false, kGreatest, kGreatestTurn);
  double t = 0;
  for (int k = 1; k <= 400; ++k) {
    const double dt = kPeriod * draw.uniform(0.8, 1.2);
    t += dt;
    timed.add(joints_at({0.2 * t, 0, 0}), dt, kPeriod, true);
    equal.add(joints_at({0.2 * k * kPeriod, 0, 0}), kPeriod, kPeriod);
  }
  EXPECT_LT(timed.unevenness(), 1e-12);
  EXPECT_LT(equal.unevenness(), 1e-12);
}

// What moves slower than a fiftieth of the limit is judged as if at that speed: noise on samples at rest is
// no unevenness that would need seconds of memory.
TEST(Series, NoiseAtRestIsJudgedByASlowSpeed) {
  constexpr double kNoise = 1e-5;  // [rad]
  std::mt19937 engine(45);
  std::normal_distribution<double> noise(0, kNoise);
  OneJoint joint;
  double sum = 0;
  constexpr int kCount = 6000;
  for (int k = 0; k < kCount; ++k) {
    joint.add(noise(engine));
    sum += joint.series.unevenness() / kCount;
  }
  EXPECT_NEAR(sum, std::sqrt(2 / std::numbers::pi) * kNoise / (kGreatest / 50),
              0.1 * kNoise / kGreatest * 50);
}

TEST(Series, AJumpIsNoVelocity) {
  OneJoint joint(0.3);
  for (int k = 0; k < 50; ++k) joint.add(0.3);
  for (int k = 0; k < 3; ++k) {
    joint.add(0.5);
    EXPECT_EQ(joint.position(), 0.5);
    EXPECT_EQ(joint.velocity(), 0);
  }
}

// The first sample after a turn says little of the velocity; the second one does.
TEST(Series, AfterATurnTheSmallerOfTwoVelocitiesCounts) {
  struct Case {
    double before, after, first;
  };
  for (const auto& [before, after, first] : {Case{0.2, -0.2, 0}, Case{0.02, 0.2, 0.02}, Case{0.2, 0.02, 0.02},
                                             Case{-0.2, -0.02, -0.02}, Case{0.2, 0, 0}, Case{0, 0.2, 0}}) {
    OneJoint joint;
    double x = 0;
    for (int k = 0; k < 200; ++k) joint.add(x += before * kPeriod);
    EXPECT_NEAR(joint.velocity(), before, 1e-9);
    joint.add(x += after * kPeriod);
    EXPECT_NEAR(joint.position(), x, 1e-12) << before << " to " << after;
    EXPECT_NEAR(joint.velocity(), first, 1e-9) << before << " to " << after;
    joint.add(x += after * kPeriod);
    EXPECT_NEAR(joint.position(), x, 1e-12) << before << " to " << after;
    EXPECT_NEAR(joint.velocity(), after, 1e-9) << before << " to " << after;
  }
}

// Uneven samples are averaged: the velocity is far closer to the truth than a difference of two samples.
TEST(Series, RemembersMoreOfUnevenSamples) {
  std::mt19937 engine(46);
  constexpr double kError = 0.1 * kPeriod, kSpeed = 0.2;
  std::normal_distribution<double> error(0, kError);
  OneJoint joint;
  double square = 0;
  constexpr int kCount = 4000;
  for (int k = 1; k <= kCount; ++k) {
    joint.add(kSpeed * (k * kPeriod + error(engine)));
    if (k > 200) square += std::pow(joint.velocity() - kSpeed, 2) / (kCount - 200);
  }
  const double of_two = std::sqrt(2.0) * kError / kPeriod * kSpeed;
  EXPECT_LT(std::sqrt(square), 0.25 * of_two);
  EXPECT_GT(std::sqrt(square), 0.01 * of_two);  // and still follows
}

// A sample that was delayed until the next one arrives: the two are no sign of a fast series.
TEST(Series, SamplesThatComeTogetherAreNoHaste) {
  OneJoint joint;
  for (int k = 1; k <= 200; ++k) joint.add(0.2 * k * kPeriod);
  joint.add(0.2 * 201 * kPeriod, 1.95 * kPeriod);
  joint.add(0.2 * 202 * kPeriod, 0.05 * kPeriod);
  EXPECT_GT(joint.velocity(), 0.1);
  EXPECT_LT(joint.velocity(), 0.4);
}

}  // namespace
}  // namespace multipanda::series_test
