#include "core/controllets/grasp_sequence.hpp"

#include <cmath>

#include <gtest/gtest.h>

namespace multipanda::grasp_sequence_test {
namespace {

using Phase = GraspSequence::Phase;

// Two hands on springs that give way to a stiff object: reduced to the numbers that the sequence uses.
struct Bench {
  GraspSequence grasp;
  GraspSettings settings{.contact_threshold_n = 2, .closing_stiffness = 400};
  GraspSequence::Measured now{.distance_m = 0.26};

  Bench() { grasp.start(now.distance_m); }
  void ticks(int count) {
    for (int i = 0; i < count; ++i) grasp.update(now, settings, 0.001);
  }
  // The hands follow the set-point down to an object 0.2 m wide with a stiffness of 10 kN/m.
  void follow(int count) {
    for (int i = 0; i < count; ++i) {
      grasp.update(now, settings, 0.001);
      now.distance_m = std::min(now.distance_m, std::max(0.1999, grasp.distance_d()));
      now.first_n = now.second_n = 1e4 * 0.5 * std::max(0.0, 0.2005 - now.distance_m);
    }
  }
};

TEST(GraspSequence, NoRequestNoMotion) {
  Bench bench;
  bench.ticks(1000);
  EXPECT_EQ(bench.grasp.phase(), Phase::rest);
  EXPECT_EQ(bench.grasp.distance_d(), 0.26);
  EXPECT_EQ(bench.grasp.spring_share(), 1);
  EXPECT_EQ(bench.grasp.force_share(), 0);
  bench.now.first_n = bench.now.second_n = 50;  // squeezed from outside: still nothing
  bench.ticks(1000);
  EXPECT_EQ(bench.grasp.phase(), Phase::rest);
}

TEST(GraspSequence, ClosesAtItsSpeedUntilBothTouch) {
  Bench bench;
  bench.now.requested_n = 20;
  bench.ticks(1);
  EXPECT_EQ(bench.grasp.phase(), Phase::approach);
  double before = bench.grasp.distance_d(), rate_before = bench.grasp.distance_rate_d();
  for (int i = 0; i < 1000; ++i) {
    bench.now.distance_m = bench.grasp.distance_d();
    bench.now.first_n = 5;  // one alone is not enough
    bench.ticks(1);
    EXPECT_NEAR((bench.grasp.distance_d() - before) / 0.001, bench.grasp.distance_rate_d(), 1e-9);
    EXPECT_GE(bench.grasp.distance_rate_d(), -bench.settings.closing_speed - 1e-12);
    EXPECT_LE(std::abs(bench.grasp.distance_rate_d() - rate_before), 0.02 * 0.001 / 0.2 + 1e-12);
    before = bench.grasp.distance_d();
    rate_before = bench.grasp.distance_rate_d();
  }
  EXPECT_EQ(bench.grasp.phase(), Phase::approach);
  EXPECT_NEAR(bench.grasp.distance_rate_d(), -0.02, 1e-12);
  EXPECT_NEAR(bench.grasp.distance_d(), 0.26 - 0.02 * (1.001 - 0.1), 2e-5);  // 0.2 s of speeding up
  bench.now.second_n = 5;
  bench.ticks(100);
  EXPECT_EQ(bench.grasp.phase(), Phase::grasp);
}

// An object that neither moves nor is detected: the spring force stays below kStrongestClosing.
TEST(GraspSequence, LimitsTheLeadOfTheSetPoint) {
  Bench bench;
  bench.now.requested_n = 20;
  bench.ticks(10000);
  EXPECT_EQ(bench.grasp.phase(), Phase::approach);
  EXPECT_NEAR(400 * (0.26 - bench.grasp.distance_d()), GraspSequence::kStrongestClosing, 1e-9);
}

TEST(GraspSequence, TheForceGrowsFromContactToTheDesiredForce) {
  Bench bench;
  bench.now.requested_n = 20;
  double before = -1, share = 0;
  bool touched = false;
  for (int i = 0; i < 8000; ++i) {
    bench.follow(1);
    EXPECT_NEAR(bench.grasp.spring_share() + bench.grasp.force_share(), 1, 1e-15);
    EXPECT_LT(std::abs(bench.grasp.force_share() - share), 1.5 * 0.001 / Fade::kDuration + 1e-9);
    share = bench.grasp.force_share();
    if (bench.grasp.touched_now()) {
      EXPECT_FALSE(touched);
      touched = true;
      // At the threshold of both, low-passed; no ramp yet.
      EXPECT_NEAR(bench.grasp.desired_n(), 2, 0.1);
      EXPECT_LT(bench.grasp.ramp(), 1e-6);
      before = bench.grasp.desired_n();
    } else if (touched) {
      // The quintic's steepest slope is 15/8 of its mean.
      EXPECT_LE(bench.grasp.desired_n() - before, 1.875 * 18.1 * 0.001);
      EXPECT_GE(bench.grasp.desired_n(), before);
      before = bench.grasp.desired_n();
    }
  }
  EXPECT_TRUE(touched);
  EXPECT_EQ(bench.grasp.desired_n(), 20);
  EXPECT_EQ(bench.grasp.ramp(), 1);
  EXPECT_EQ(bench.grasp.force_share(), 1);
  bench.now.requested_n = 30;  // follows the requested force
  bench.ticks(1);
  EXPECT_EQ(bench.grasp.desired_n(), 30);
}

TEST(GraspSequence, ALostObjectIsNotApproachedAgain) {
  Bench bench;
  bench.now.requested_n = 20;
  bench.follow(8000);
  ASSERT_EQ(bench.grasp.phase(), Phase::grasp);
  bench.now.first_n = 0;
  bench.now.distance_m = 0.18;
  bench.ticks(150);
  EXPECT_EQ(bench.grasp.phase(), Phase::lost);
  EXPECT_EQ(bench.grasp.distance_d(), 0.18);
  bench.ticks(300);
  EXPECT_EQ(bench.grasp.force_share(), 0);
  EXPECT_EQ(bench.grasp.ramp(), 0);  // the weight of the object is gone, too
  EXPECT_EQ(bench.grasp.distance_d(), 0.18);
  bench.now.first_n = 10;  // touched again by chance
  bench.ticks(1000);
  EXPECT_EQ(bench.grasp.phase(), Phase::lost);
  bench.now.requested_n = 0;
  bench.ticks(1);
  EXPECT_EQ(bench.grasp.phase(), Phase::rest);
  bench.now.requested_n = 20;
  bench.ticks(2);
  EXPECT_NE(bench.grasp.phase(), Phase::lost);
}

TEST(GraspSequence, ReleasingOpensTheHands) {
  Bench bench;
  bench.now.requested_n = 20;
  bench.follow(8000);
  bench.now.requested_n = 0;
  const double closed = bench.now.distance_m;
  bench.ticks(1);
  EXPECT_EQ(bench.grasp.phase(), Phase::rest);
  bench.ticks(198);
  EXPECT_NEAR(bench.grasp.distance_d(), closed, 1e-9);  // not before the force has vanished
  bench.ticks(3000);
  EXPECT_NEAR(bench.grasp.distance_d(), closed + bench.settings.release_distance_m, 3e-3);
  EXPECT_NEAR(bench.grasp.distance_rate_d(), 0, 1e-12);
}

}  // namespace
}  // namespace multipanda::grasp_sequence_test
