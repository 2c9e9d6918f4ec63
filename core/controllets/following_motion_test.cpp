#include "core/controllets/following_motion.hpp"

#include <cmath>

#include <gtest/gtest.h>

namespace multipanda::following_motion_test {
namespace {

constexpr double kDt = 0.001;
constexpr FollowingLimits kLimits{.first = 0, .count = 3, .speed = 0.25, .acceleration = 3, .jerk = 250};

// A set-point along three coordinates and its target.
struct Follower {
  Follower() {
    motion.start(3);
    resistance.start(3);
  }
  void resist(double share) {
    for (int k = 0; k < 1000; ++k) resistance.update(Vector3(0, 0, -60), share, kDt);
  }

  void step(const Vector3& target, const Vector3& velocity) {
    const JointVector a = motion.acceleration();
    motion.advance(motion.desired(target - x, velocity, kLimits, resistance, kDt), kLimits, kDt);
    x += kDt * motion.velocity();
    fastest = std::max(fastest, motion.velocity().norm());
    hardest = std::max(hardest, motion.acceleration().norm());
    jerk = std::max(jerk, (motion.acceleration() - a).norm() / kDt);
  }

  FollowingMotion motion;
  Vector3 x = Vector3::Zero();
  Resistance resistance;
  double fastest = 0, hardest = 0, jerk = 0;
};

// From the poles: 3 a / p^2 behind a target with the acceleration a, nothing behind one with none.
TEST(FollowingMotion, LagsBehindAnAcceleratedTargetOnly) {
  Follower follower;
  const Vector3 n = Vector3(1, -2, 0.5).normalized();
  const double a = 0.5;
  for (int k = 0; k < 400; ++k) {
    const double t = kDt * (k + 1);
    follower.step(0.5 * a * t * t * n, a * t * n);
  }
  const double t = 0.4;
  const Vector3 lag = 0.5 * a * t * t * n - follower.x;
  const double expected = 3 * a / (FollowingMotion::kPole * FollowingMotion::kPole);
  EXPECT_NEAR(n.dot(lag), expected, 0.1 * expected + 0.5 * a * t * kDt);
  EXPECT_LT((lag - n.dot(lag) * n).norm(), 1e-12);
  for (int k = 0; k < 300; ++k) {  // on with constant velocity
    const double further = a * t * kDt * (k + 1);
    follower.step((0.5 * a * t * t + further) * n, a * t * n);
  }
  EXPECT_LT(((0.5 * a * t * t + a * t * 0.3) * n - follower.x).norm(), 5e-5);
}

TEST(FollowingMotion, GoesToATargetThatJumpsWithinItsLimitsAndDoesNotPassIt) {
  Follower follower;
  const Vector3 target(0.3, -0.1, 0.2);
  double beyond = 0;
  for (int k = 0; k < 4000; ++k) {
    follower.step(target, Vector3::Zero());
    beyond = std::max(beyond, follower.x.dot(target) / target.norm() - target.norm());
  }
  EXPECT_LT((follower.x - target).norm(), 1e-6);
  EXPECT_LT(beyond, 2e-4);
  EXPECT_LT(follower.fastest, 1.02 * kLimits.speed);
  EXPECT_GT(follower.fastest, 0.98 * kLimits.speed);
  EXPECT_LE(follower.hardest, kLimits.acceleration * 1.001);
  EXPECT_LE(follower.jerk, kLimits.jerk * 1.001);
}

TEST(FollowingMotion, WaitsAlongAPullThatIsAsStrongAsItMayBeAndSlidesAcrossIt) {
  Follower follower;
  follower.resist(1);
  for (int k = 0; k < 2000; ++k) follower.step(Vector3(0.1, 0, -0.1), Vector3::Zero());
  EXPECT_NEAR(follower.x.x(), 0.1, 1e-4);
  EXPECT_NEAR(follower.x.z(), 0, 1e-9);
  follower.resist(0.9);  // half of the speed
  const double before = follower.x.z();
  for (int k = 0; k < 200; ++k) follower.step(Vector3(0.1, 0, -1), Vector3::Zero());
  EXPECT_NEAR((follower.x.z() - before) / 0.2, -0.125, 0.02);
  follower.resist(2);  // it may always go back
  for (int k = 0; k < 2000; ++k) follower.step(Vector3(0.1, 0, 0.1), Vector3::Zero());
  EXPECT_NEAR(follower.x.z(), 0.1, 1e-4);
}

TEST(FollowingMotion, WaitsAsAWholeWhereItIsToldTo) {
  Follower follower;
  follower.resistance.start(3, Resistance::Waits::all);
  follower.resist(1);
  for (int k = 0; k < 2000; ++k) follower.step(Vector3(0.1, 0, -0.1), Vector3::Zero());
  EXPECT_LT(follower.x.norm(), 1e-9);
  for (int k = 0; k < 2000; ++k) follower.step(Vector3(0.1, 0, 0.1), Vector3::Zero());
  EXPECT_LT((follower.x - Vector3(0.1, 0, 0.1)).norm(), 1e-4);
}

// A point p further on the same body: its velocity and acceleration from its own motion, by differences.
TEST(FollowingMotion, IsCarriedToAnotherPointOfTheBody) {
  FollowingMotion motion;
  motion.start(6);
  const JointVector v_w = Vector3(0.1, -0.05, 0.08), omega_w = Vector3(0.4, 0.3, -0.5);
  const FollowingLimits linear{.first = 0, .count = 3, .speed = 1, .acceleration = 4, .jerk = 400},
      angular{.first = 3, .count = 3, .speed = 1, .acceleration = 8, .jerk = 800};
  for (int k = 0; k < 20; ++k) {
    motion.advance(v_w, linear, kDt);
    motion.advance(omega_w, angular, kDt);
  }
  const Vector3 p(0.1, 0.2, -0.05);
  const Vector6 V = motion.velocity(), A = motion.acceleration();
  // r(t) = x(t) + R(t) p, with x and the rotation vector to the second order.
  const auto point = [&](double t) -> Vector3 {
    const Vector3 x = t * V.head<3>() + 0.5 * t * t * A.head<3>();
    const Vector3 r = t * V.tail<3>() + 0.5 * t * t * A.tail<3>();
    return x + exp_rotation(r) * p;
  };
  motion.carry(p);
  const double h = 1e-4;
  const Vector3 v = (point(h) - point(-h)) / (2 * h), a = (point(h) - 2 * point(0) + point(-h)) / (h * h);
  EXPECT_LT((motion.velocity().head<3>() - v).norm(), 1e-6);
  EXPECT_LT((motion.acceleration().head<3>() - a).norm(), 1e-5);
}

}  // namespace
}  // namespace multipanda::following_motion_test
