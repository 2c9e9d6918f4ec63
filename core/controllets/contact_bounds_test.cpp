#include "core/controllets/contact_bounds.hpp"

#include <array>
#include <cmath>
#include <random>
#include <utility>

#include <gtest/gtest.h>

namespace multipanda {
namespace {

Vector6 some(std::mt19937& random, double size) {
  std::normal_distribution<double> normal(0, size);
  Vector6 v;
  for (int i = 0; i < 6; ++i) v[i] = normal(random);
  return v;
}

// What remains is along the pull and, with the damping, no more than the bound along it.
TEST(ContactBounds, PullLessDampingStaysWithinTheBound) {
  std::mt19937 random(7);
  const ContactBounds bounds;
  int bounded_ones = 0;
  for (int k = 0; k < 2000; ++k) {
    const Vector6 pull = some(random, 50), damping = some(random, 25);
    const BoundedPull bounded = bound_pull(bounds, pull, damping, Vector3::Zero());
    const Vector6 left = bounded.remaining(pull);
    for (const int at : {0, 3}) {
      const Vector3 p = pull.segment<3>(at), d = damping.segment<3>(at), r = left.segment<3>(at);
      const double most = at == 0 ? bounds.spring_force : bounds.spring_moment;
      EXPECT_LT(p.cross(r).norm(), 1e-9 * p.squaredNorm());
      EXPECT_LE(p.normalized().dot(r - std::max(0.0, p.normalized().dot(d)) * p.normalized()), most + 1e-9);
      if (p.norm() <= most) {
        EXPECT_EQ(r, p);
      }
      bounded_ones += r != p;
    }
    EXPECT_LE((pull * bounded.factor()).head<3>().norm(), left.head<3>().norm() + 1e-9);
  }
  EXPECT_GT(bounded_ones, 500);
}

// A point mass that is let go ahead of nothing but a pull: it ends where the greatest net force is zero.
TEST(ContactBounds, AHandThatIsLetGoIsNotMuchFasterThanItsSetPoint) {
  std::mt19937 random(10);
  for (int k = 0; k < 200; ++k) {
    std::uniform_real_distribution<double> unit(0, 1);
    const double m = 1 + 9 * unit(random), stiffness = 50 + 3000 * unit(random);
    const double D = 1.4 * std::sqrt(m * stiffness);
    const ContactBounds bounds{.hand_speed = 0.1 + 0.2 * unit(random)};
    const Vector3 n = some(random, 1).head<3>().normalized();
    Vector3 x = -60 / stiffness * n, v = Vector3::Zero();
    double fastest = 0;
    for (int i = 0; i < 5000; ++i) {
      const Vector6 pull = (Vector6() << -stiffness * x, Vector3::Zero()).finished();
      const Vector6 damping = (Vector6() << D * v, Vector3::Zero()).finished();
      const Vector3 force = bound_pull(bounds, pull, damping, v).remaining(pull).head<3>();
      v += 2e-4 / m * (force - D * v);
      x += 2e-4 * v;
      fastest = std::max(fastest, v.norm());
    }
    EXPECT_LE(fastest, std::max(1.5 * bounds.hand_speed, bounds.spring_force / 300));
    EXPECT_LT(x.norm(), 60 / stiffness);
  }
}

// Behind three periods of delay. The pull of a hand that is let go only falls: where it rises again and
// again, it shakes the hand.
TEST(ContactBounds, SlowHandsDoNotShake) {
  constexpr int kDelay = 3;
  for (const double hand_speed : {0.01, 0.02, 0.05, 0.1, 0.25}) {
    for (const double spring_force : {30.0, 60.0, 140.0}) {
      for (const double m : {1.0, 3.0, 6.0}) {
        const ContactBounds bounds{.hand_speed = hand_speed, .spring_force = spring_force};
        const double stiffness = 400, D = 2 * std::sqrt(m * stiffness);
        double x = -1.3 * spring_force / stiffness, v = 0, before = spring_force, rises = 0;
        std::array<double, kDelay> late{};
        for (int i = 0; i < 4000; ++i) {
          const Vector6 pull = -stiffness * x * Vector6::Unit(0);
          const Vector6 left =
              bound_pull(bounds, pull, D * v * Vector6::Unit(0), v * Vector3::UnitX()).remaining(pull);
          const double force = std::exchange(late.at(static_cast<std::size_t>(i % kDelay)), left[0] - D * v);
          rises += std::max(0.0, left[0] - before);
          before = left[0];
          for (int k = 0; k < 10; ++k) {
            v += 1e-4 / m * force;
            x += 1e-4 * v;
          }
        }
        EXPECT_LT(rises, spring_force) << hand_speed << " m/s, " << spring_force << " N, " << m << " kg";
      }
    }
  }
}

TEST(ContactBounds, TheMomentDoesNotDependOnTheVelocity) {
  std::mt19937 random(11);
  for (int k = 0; k < 100; ++k) {
    const Vector6 pull = some(random, 50), damping = some(random, 25);
    EXPECT_EQ(bound_pull({}, pull, damping, some(random, 1).head<3>()).moment_share,
              bound_pull({}, pull, damping, Vector3::Zero()).moment_share);
  }
}

TEST(ContactBounds, LiftedChangesNothing) {
  std::mt19937 random(8);
  for (int k = 0; k < 100; ++k) {
    const Vector6 pull = some(random, 1e4);
    const BoundedPull bounded =
        bound_pull(ContactBounds::lifted(), pull, some(random, 10), some(random, 1).head<3>());
    EXPECT_EQ(bounded.factor(), 1);
    EXPECT_EQ(bounded.remaining(pull), pull);
  }
}

TEST(ContactBounds, WhereNothingIsAllowedSmallPullsGoToo) {
  const ContactBounds none{.hand_speed = 0.25, .spring_force = 0, .spring_moment = 0};
  std::mt19937 random(10);
  for (int k = 0; k < 100; ++k) {
    const Vector6 pull = some(random, 0.2);
    EXPECT_LT(bound_pull(none, pull, Vector6::Zero(), Vector3::Zero()).remaining(pull).norm(), 1e-5);
    // Half of it opposed by damping: this half stays.
    const Vector6 left = bound_pull(none, pull, 0.5 * pull, Vector3::Zero()).remaining(pull);
    EXPECT_LT((left - 0.5 * pull).norm(), 1e-12);
  }
}

TEST(ContactBounds, LargestShareEndsOnTheLimit) {
  std::mt19937 random(9);
  for (const double limit : {60.0, 0.5}) {
    for (int k = 0; k < 1000; ++k) {
      Vector3 base = some(random, limit / 2).head<3>();
      if (base.norm() > 0.99 * limit) base *= 0.99 * limit / base.norm();
      const Vector3 extra = some(random, limit).head<3>();
      const double c = largest_share(base, extra, limit);
      if (c < 1) {
        EXPECT_NEAR((base + c * extra).norm(), limit, 1e-10 * limit);
      } else {
        EXPECT_LE((base + extra).norm(), limit);
      }
    }
    for (int k = 0; k < 100; ++k) {
      const Vector3 across = some(random, limit / 2).head<3>();
      const double left = left_beside(across, limit);
      EXPECT_NEAR(std::hypot(across.norm(), left), std::max(limit, across.norm()), 1e-10 * limit);
      EXPECT_GE(left, 0);
    }
    // A base beyond the limit by rounding goes no farther.
    const Vector3 outside(0, limit * (1 + 1e-12), 0);
    EXPECT_EQ(largest_share(outside, 2 * outside, limit), 0);
  }
}

}  // namespace
}  // namespace multipanda
