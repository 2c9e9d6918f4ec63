// One coordinate that follows a reference, against the limits themselves.
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "core/types/time.hpp"
#include "runtime/embedded/command_follower.hpp"
#include "runtime/embedded/sample_track.hpp"

namespace multipanda::axis_follower_test {
namespace {

constexpr AxisLimits kLimits{.velocity = 2, .acceleration = 7, .jerk = 3000, .catch_up = 0.25};

// Counts differences of the positions, as an arm does, and not the follower's own derivatives.
struct Watch {
  explicit Watch(const AxisLimits& limits) : most(limits) {}
  void see(double x) {
    const double v_now = (x - x_) / kArmPeriod, a_now = (v_now - v_) / kArmPeriod;
    if (count_ > 2) {
      jerk = std::max(jerk, std::abs(a_now - a_) / kArmPeriod / most.jerk);
      acceleration = std::max(acceleration, std::abs(a_now) / most.acceleration);
      velocity = std::max(velocity, std::abs(v_now) / most.velocity);
    }
    x_ = x, v_ = v_now, a_ = a_now;
    ++count_;
  }
  AxisLimits most;
  double velocity = 0, acceleration = 0, jerk = 0;  // greatest, as a share of the limit

 private:
  double x_ = 0, v_ = 0, a_ = 0;
  int count_ = 0;
};

TEST(AxisFollower, KeepsItsLimitsWhateverTheReferenceDoes) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> draw(-1, 1);
  AxisState state;
  Watch watch(kLimits);
  double x_d = 0, v_d = 0;
  for (int k = 0; k < 200'000; ++k) {
    if (k % 50 == 0) x_d = 3 * draw(random);
    if (k % 7 == 0) v_d = 10 * draw(random);
    if (k % 1000 < 500) v_d = 0;
    follow_position(kLimits, x_d, v_d, state);
    watch.see(state.x);
  }
  EXPECT_LT(watch.jerk, 1 + 1e-6);
  EXPECT_GT(watch.jerk, 0.9);
  EXPECT_LT(watch.acceleration, 1 + 1e-6);
  EXPECT_GT(watch.acceleration, 0.9);
  EXPECT_LT(watch.velocity, 1 + 1e-6);
}

TEST(AxisFollower, AJumpIsApproachedSlowlyAndWithoutOvershoot) {
  for (const double jump : {1e-4, 1e-3, 0.01, 0.1, 1.0}) {
    AxisState state;
    double fastest = 0, farthest = 0;
    for (int k = 0; k < 8000; ++k) {
      follow_position(kLimits, jump, 0, state);
      fastest = std::max(fastest, std::abs(state.v));
      farthest = std::max(farthest, state.x);
    }
    EXPECT_LT(fastest, kLimits.catch_up * 1.02) << jump;
    EXPECT_NEAR(state.x, jump, 1e-9) << jump;
    EXPECT_LT(farthest, jump * 1.02) << jump;
    EXPECT_NEAR(state.v, 0, 1e-9) << jump;
  }
}

// The documented lag: none at constant velocity, 3 a / w^2 at constant acceleration, of which the velocity of
// the period's end takes away the share w T.
TEST(AxisFollower, FollowsVelocitiesWithoutLagAndAccelerationsWithALittle) {
  AxisState state;
  double x_d = 0;
  for (int k = 0; k < 3000; ++k) follow_position(kLimits, x_d += 0.5 * kArmPeriod, 0.5, state);
  EXPECT_NEAR(state.x, x_d, 1e-9);
  EXPECT_NEAR(state.v, 0.5, 1e-9);

  state = {};
  const double a = 2;
  double v_d = 0;
  x_d = 0;
  for (int k = 0; k < 500; ++k) {
    v_d += a * kArmPeriod;
    follow_position(kLimits, x_d += v_d * kArmPeriod, v_d, state);
  }
  EXPECT_NEAR(state.v, v_d, 1e-6);
  const double w = kFollowerBandwidth, lag = 3 * a / (w * w) * (1 - w * kArmPeriod);
  EXPECT_NEAR(x_d - state.x, lag, 0.03 * lag);
}

TEST(AxisFollower, StopsFromEverySpeedAndHoldsThere) {
  for (const double v : {0.05, 0.5, 2.0}) {
    AxisState state{.x = 1, .v = v, .a = 3};
    double before = state.a;
    for (int k = 0; k < 1500; ++k) {
      follow_velocity(kLimits, 0, state);
      EXPECT_LT(std::abs(state.a - before), kLimits.jerk * kArmPeriod * (1 + 1e-9));
      before = state.a;
    }
    EXPECT_NEAR(state.v, 0, 1e-9);
    // Not farther than braking with half of the acceleration, and 20 ms until it has built up.
    EXPECT_LT(state.x - 1, v * v / kLimits.acceleration + 0.02 * v + 0.003) << v;
  }
}

TEST(AxisFollower, EndsOfTheRangeAreApproachedAlongACurve) {
  AxisLimits limits = kLimits;
  limits.lower = -0.4;
  limits.upper = 0.6;
  limits.deceleration = 3;
  limits.offset = 0.25;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> draw(-1, 1);
  AxisState state;
  Watch watch(limits);
  double v_d = 0, farthest = 0, over = 0;
  for (int k = 0; k < 100'000; ++k) {
    if (k % 300 == 0) v_d = 3 * draw(random);
    follow_velocity(limits, v_d, state);
    watch.see(state.x);
    farthest = std::max({farthest, state.x - limits.upper, limits.lower - state.x});
    over = std::max(
        {over, state.v - upper_velocity(limits, state.x), lower_velocity(limits, state.x) - state.v});
  }
  EXPECT_LT(farthest, 1e-3);
  EXPECT_LT(over, 0.05);  // [u/s] while it turns into the curve
  EXPECT_LT(watch.jerk, 1 + 1e-6);
  EXPECT_LT(watch.acceleration, 1 + 1e-6);
}

// --- the track ---

// 0.7 u/s, written with a jitter of up to 0.9 ms by a clock that is 80 ppm fast: the stamps tell the truth,
// so the playback is the same line, one delay late.
TEST(SampleTrack, PlaysBackOnTheArmsClockWhatAJitteryProgramWrote) {
  SampleTrack track;
  std::mt19937 random(11);
  std::uniform_real_distribution<double> draw(0, 0.9e-3);
  const double drift = 80e-6, speed = 0.7;
  double arm = 0, next = 0, wake = draw(random), before = 0, worst = 0;
  for (int k = 0; k < 20'000; ++k, arm += kArmPeriod) {
    while (wake <= arm) {
      const double stamp = wake * (1 + drift), value[1] = {speed * stamp};
      track.push(static_cast<std::int64_t>(stamp * 1e9), value);
      next += 1e-3;
      wake = next + draw(random);
    }
    if (track.empty()) continue;
    track.advance();
    const SampleTrack::Place place = track.place();
    const double from = place.from->values[0], to = place.to->values[0];
    const double x =
        from + place.share * (to - from) + (place.gap > 0 ? (to - from) / place.gap * place.beyond : 0);
    if (k > 5000) {
      worst = std::max(worst, std::abs((x - before) / kArmPeriod - speed * (1 + drift)));
      EXPECT_NEAR(arm - x / speed / (1 + drift), track.delay() + 0.5e-3, 1.2e-3);
    }
    before = x;
  }
  EXPECT_LT(worst, 0.01 * speed);
  EXPECT_NEAR(track.drift(), drift, 40e-6);
  EXPECT_NEAR(track.delay(), 3e-3, 0.2e-3);
}

TEST(SampleTrack, WithoutCommandsAMotionIsKeptAndThenSlows) {
  EXPECT_EQ(kept_velocity(0), 1);
  EXPECT_EQ(kept_velocity(kKeptMotion), 1);
  EXPECT_NEAR(kept_velocity(kKeptMotion + kSlowing / 2), 0.5, 1e-12);
  EXPECT_EQ(kept_velocity(1), 0);
  double distance = 0;
  for (double t = 0; t < 0.2; t += 1e-5) {
    EXPECT_NEAR(kept_distance(t), distance, 1e-5) << t;
    distance += 1e-5 * kept_velocity(t);
  }
}

TEST(SampleTrack, AClockThatGoesBackBeginsAnew) {
  SampleTrack track;
  const double one[1] = {1}, two[1] = {2};
  track.push(5'000'000'000, one);
  track.push(1'000'000'000, two);
  track.advance();
  EXPECT_EQ(track.place().to->values[0], 2);
  EXPECT_EQ(track.place().gap, 0);
}

}  // namespace
}  // namespace multipanda::axis_follower_test
