#include "core/controllets/contact_bounds.hpp"

#include <cmath>
#include <random>

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
    EXPECT_LE(fastest, 1.5 * bounds.hand_speed);
    EXPECT_LT(x.norm(), 60 / stiffness);
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

TEST(ContactBounds, LargestShareEndsOnTheLimit) {
  std::mt19937 random(9);
  for (int k = 0; k < 1000; ++k) {
    Vector3 base = some(random, 30).head<3>();
    if (base.norm() > 59) base *= 59 / base.norm();
    const Vector3 extra = some(random, 60).head<3>();
    const double c = largest_share(base, extra, 60);
    if (c < 1) {
      EXPECT_NEAR((base + c * extra).norm(), 60, 1e-9);
    } else {
      EXPECT_LE((base + extra).norm(), 60);
    }
  }
}

}  // namespace
}  // namespace multipanda
