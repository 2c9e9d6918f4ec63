#include "motion_generators/circular_field/field.hpp"

#include <array>
#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace multipanda::circular_field::field_test {
namespace {

class Draw {
 public:
  explicit Draw(std::uint32_t seed) : engine_(seed) {}
  double uniform(double a, double b) { return std::uniform_real_distribution<double>(a, b)(engine_); }
  Vector3 vector(double size) { return {uniform(-size, size), uniform(-size, size), uniform(-size, size)}; }

 private:
  std::mt19937 engine_;
};

TEST(CircularField, ObstacleForceDoesNoWorkAndTurnsAway) {
  Draw draw(1);
  const FieldGains gains;
  int acting = 0, away = 0;
  for (int trial = 0; trial < 20'000; ++trial) {
    const Ball hand{draw.vector(0.3), draw.vector(trial % 3 == 0 ? 1e-4 : 0.5), 0.08};
    const Ball obstacle{draw.vector(0.3), draw.vector(0.1), draw.uniform(0.02, 0.1)};
    const Vector3 side =
        passing_side(hand, obstacle, trial % 2 == 0 ? Vector3::Zero().eval() : Vector3::UnitY().eval());
    ASSERT_NEAR(side.norm(), 1, 1e-12);
    const Vector3 F = circular_force(gains, hand, obstacle, side);
    ASSERT_LE(std::abs(F.dot(hand.velocity)), 1e-9);
    const double gap = (hand.position - obstacle.position).norm() - hand.radius - obstacle.radius;
    if (gap >= gains.range) {
      ASSERT_EQ(F.norm(), 0);
      continue;
    }
    // The turn rate of the velocity, |F| / |v|, stays below its maximum.
    ASSERT_LE(F.norm(), gains.turn_rate * hand.velocity.norm() + 1e-12);
    if (F.norm() < 1e-6) continue;
    ++acting;
    away += F.dot(side) > 0 ? 1 : 0;
  }
  EXPECT_GT(acting, 1000);
  EXPECT_EQ(away, acting);
}

// Away from the fade at slow speed: the force as in textbooks, v x B with B = c x v Omega / |v|,
// here in components of v and the part of c across v.
TEST(CircularField, ForceHasTheStatedSize) {
  FieldGains gains;
  const Ball hand{{-0.2, 0.02, 0}, {0.4, 0, 0}, 0.05};
  const Ball obstacle{{0, 0, 0}, {0, 0, 0}, 0.05};
  const Vector3 side = passing_side(hand, obstacle, Vector3::Zero());
  EXPECT_NEAR((side - Vector3::UnitY()).norm(), 0, 1e-12);  // passes at y = 0.02
  const double gap = std::hypot(0.2, 0.02) - 0.1, near = 1 - gap / gains.range;
  const double expected = gains.turn_rate * near * near * 0.4 * 0.4 / 0.41;
  const Vector3 F = circular_force(gains, hand, obstacle, side);
  EXPECT_NEAR(F.y(), expected, 1e-12);
  EXPECT_NEAR(F.x(), 0, 1e-12);
  EXPECT_NEAR(F.z(), 0, 1e-12);
  // No force when the hand moves away.
  EXPECT_EQ(circular_force(gains, {hand.position, {-0.4, 0, 0}, 0.05}, obstacle, side).norm(), 0);
}

TEST(CircularField, TwoHandsThatMeetHeadOnTakeOppositeSides) {
  Draw draw(2);
  for (int trial = 0; trial < 100; ++trial) {
    const Vector3 direction = draw.vector(1).normalized();
    const Ball a{-0.2 * direction, 0.3 * direction, 0.08}, b{0.2 * direction, -0.3 * direction, 0.08};
    const Vector3 side_a = passing_side(a, b, Vector3::Zero()), side_b = passing_side(b, a, Vector3::Zero());
    EXPECT_LT((side_a + side_b).norm(), 1e-9);
    EXPECT_LT(std::abs(side_a.dot(direction)), 1e-9);
  }
  // The previous side decides if the motion does not.
  const Ball a{{-0.2, 0, 0}, {0.3, 0, 0}, 0.08}, b{{0, 0, 0}, {0, 0, 0}, 0.08};
  EXPECT_LT((passing_side(a, b, Vector3::UnitZ()) - Vector3::UnitZ()).norm(), 1e-9);
}

TEST(CircularField, AttractionUsesTheCruiseSpeedAndLessNearTheGoal) {
  const FieldGains gains;
  const Vector3 far(2, 0, 0), near(0, 0.01, 0);
  EXPECT_NEAR(attraction(gains, far, {0.4, 0, 0}).norm(), 0, 1e-12);
  EXPECT_NEAR(attraction(gains, near, {0, 0, 0}).y(), 6 * 1.5 * 0.01, 1e-12);
  EXPECT_NEAR(attraction(gains, far, {0, 0, 0}).x(), 6 * 0.4, 1e-12);
}

// For the nearest point of a convex set, every allowed point lies beyond it: (a - p).(x - p) <= 0.
TEST(CircularField, NearestAllowedIsTheProjection) {
  Draw draw(3);
  std::array<double, 8> multipliers{};
  int moved = 0;
  for (int trial = 0; trial < 500; ++trial) {
    std::vector<Barrier> barriers;
    for (int i = 0; i < 4; ++i) barriers.push_back({draw.vector(1).normalized(), draw.uniform(-2, 0.3)});
    const Vector3 a = draw.vector(3), p = nearest_allowed(a, barriers, multipliers);
    const auto allowed = [&](const Vector3& x, double slack) {
      for (const auto& b : barriers) {
        if (b.normal.dot(x) < b.bound - slack) return false;
      }
      return true;
    };
    if (!allowed(p, 1e-6)) continue;  // sharp wedges take more sweeps than there are; counted below
    if (allowed(a, 0)) {
      EXPECT_LT((p - a).norm(), 1e-12);
    }
    moved += (p - a).norm() > 1e-6 ? 1 : 0;
    for (int k = 0; k < 50; ++k) {
      const Vector3 x = draw.vector(4);
      if (allowed(x, 0)) {
        EXPECT_LE((a - p).dot(x - p), 1e-5);
      }
    }
  }
  EXPECT_GT(moved, 250);
}

// Under the barrier alone, a gap closes no faster than the critically damped motion h' = -k h, whatever the
// desired acceleration.
TEST(CircularField, BarrierKeepsTheClearance) {
  const FieldGains gains;
  std::array<double, 1> multiplier{};
  Ball hand{{-0.4, 0, 0}, {0.45, 0, 0}, 0.05};
  Ball obstacle{{0, 0, 0}, {-0.1, 0, 0}, 0.06};
  double least = 1;
  for (int k = 0; k < 5000; ++k) {
    const Barrier barrier = ball_barrier(gains, hand, obstacle, 1);
    const Vector3 a = nearest_allowed({6, 0, 0}, std::span(&barrier, 1), multiplier);
    hand.velocity += 1e-3 * a;
    hand.position += 1e-3 * hand.velocity;
    obstacle.position += 1e-3 * obstacle.velocity;
    least = std::min(least, (hand.position - obstacle.position).norm() - 0.11);
  }
  EXPECT_GT(least, gains.clearance - 1e-3);
  EXPECT_LT(least, gains.clearance + 0.01);  // the hand came close, so the barrier acted
}

}  // namespace
}  // namespace multipanda::circular_field::field_test
