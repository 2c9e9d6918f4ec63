#include "core/trajectory/pose_motion.hpp"

#include <cmath>
#include <random>
#include <stdexcept>

#include <gtest/gtest.h>

namespace multipanda::pose_motion_test {
namespace {

using Random = std::mt19937_64;

Vector3 in_ball(Random& random, double radius) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> share(0, 1);
  Vector3 v;
  for (int i = 2; i >= 0; --i) v[i] = normal(random);
  return radius * std::cbrt(share(random)) * v.normalized();
}

Pose random_pose(Random& random, double meters, double radians) {
  return {exp_rotation(in_ball(random, radians)), in_ball(random, meters)};
}

PoseSample resting(const Pose& X) { return {X, {}, {}}; }

// Fractions of the limits, from differences of poses alone.
struct Seen {
  double speed = 0, acceleration = 0, jerk = 0, turning = 0, angular_acceleration = 0, angular_jerk = 0;
  double twist_error = 0, rate_error = 0;
};

Seen look(const PoseMotion& motion, const PoseMotionLimits& limits, double scale) {
  const double h = 5e-4;
  Seen seen;
  const auto difference = [&](double t) -> Vector6 {  // mean twist over [t - h, t + h]
    return pose_error(motion.sample(t + h).X, motion.sample(t - h).X) / (2 * h);
  };
  const auto most = [](double& value, double candidate) { value = std::max(value, candidate); };
  for (double t = 3 * h; t < motion.duration() - 3 * h; t += 3 * h) {
    const Vector6 before = difference(t - h), now = difference(t), after = difference(t + h);
    const Vector6 rate = (after - before) / (2 * h), second = (after - 2 * now + before) / (h * h);
    const PoseSample said = motion.sample(t);
    most(seen.speed, now.head<3>().norm() / (scale * limits.speed));
    most(seen.turning, now.tail<3>().norm() / (scale * limits.angular_speed));
    most(seen.acceleration, rate.head<3>().norm() / (scale * limits.acceleration));
    most(seen.angular_acceleration, rate.tail<3>().norm() / (scale * limits.angular_acceleration));
    most(seen.jerk, second.head<3>().norm() / (scale * limits.jerk));
    most(seen.angular_jerk, second.tail<3>().norm() / (scale * limits.angular_jerk));
    most(seen.twist_error, (now - said.V.vector).norm());
    most(seen.rate_error, (rate - said.A.vector).norm());
  }
  return seen;
}

TEST(PoseViaMotion, KeepsItsLimitsUsesThemAndPassesEveryPoint) {
  Random random(17);
  for (int trial = 0; trial < 40; ++trial) {
    std::uniform_real_distribution<double> share(0.2, 1);
    const PoseMotionLimits limits{.speed = share(random),
                                  .acceleration = 5 * share(random),
                                  .jerk = 100 * share(random),
                                  .angular_speed = 2 * share(random),
                                  .angular_acceleration = 10 * share(random),
                                  .angular_jerk = 200 * share(random)};
    const double scale = trial % 3 == 0 ? 1 : share(random);
    const Pose start = random_pose(random, 0.5, 1);
    std::vector<Pose> via;
    const int count = std::uniform_int_distribution<int>(1, 6)(random);
    for (int k = 0; k < count; ++k) {
      // Some trials only translate, some only rotate.
      Pose X = random_pose(random, trial % 4 == 1 ? 0.02 : 0.5, 1.4);
      if (trial % 5 == 3) X.rotation = start.rotation;
      if (trial % 5 == 4) X.position = start.position;
      via.push_back(X);
    }
    const PoseMotion motion = pose_via_motion(resting(start), via, limits, scale);
    const Seen seen = look(motion, limits, scale);
    for (const double reached : {seen.speed, seen.acceleration, seen.turning, seen.angular_acceleration})
      EXPECT_LE(reached, 1.001);
    EXPECT_LE(seen.jerk, 1.02);  // differences of differences
    EXPECT_LE(seen.angular_jerk, 1.04);
    EXPECT_GE(std::max({seen.speed, seen.acceleration, seen.jerk, seen.turning, seen.angular_acceleration,
                        seen.angular_jerk}),
              0.9);
    // The motion's own derivatives agree with the differences, so velocity and acceleration have no jump.
    EXPECT_LE(seen.twist_error, 2e-4);
    EXPECT_LE(seen.rate_error, 2 * 5e-4 * scale * (limits.jerk + limits.angular_jerk));
    ASSERT_EQ(motion.knots().size(), via.size());
    for (std::size_t k = 0; k < via.size(); ++k)
      EXPECT_LT(pose_error(motion.sample(motion.knots()[k]).X, via[k]).norm(), 1e-9);
    EXPECT_EQ(motion.knots().back(), motion.duration());
    EXPECT_LT(pose_error(motion.sample(0).X, start).norm(), 1e-12);
    EXPECT_LT(motion.sample(motion.duration() - 1e-9).V.vector.norm(), 1e-6);
    double stops = 0;
    Pose last = start;
    for (const auto& X : via) {
      stops += pose_via_motion(resting(last), {&X, 1}, limits, scale).duration();
      last = X;
    }
    EXPECT_LE(motion.duration(), stops * 1.0001);
  }
}

TEST(PoseViaMotion, StraightPathTakesTheTimeOfTheClosedFormAndStaysOnTheLine) {
  const PoseMotionLimits wide{1000, 1e6, 1e9, 1000, 1e6, 1e9};
  const Pose goal{exp_rotation({0, 0.6, 0.8}), Vector3(0.3, -0.4, 0)};  // 0.5 m, 1 rad
  const auto motion = [&](PoseMotionLimits limits) {
    return pose_via_motion(resting(Pose{}), {&goal, 1}, limits);
  };
  PoseMotionLimits slow = wide, slow_turn = wide, soft = wide;
  slow.speed = 0.2;
  slow_turn.angular_speed = 0.5;
  soft.acceleration = 2;
  EXPECT_NEAR(motion(slow).duration(), 15.0 / 8 * 0.5 / 0.2, 0.01 * 4.69);
  EXPECT_NEAR(motion(slow_turn).duration(), 15.0 / 8 * 1 / 0.5, 0.01 * 3.75);
  EXPECT_NEAR(motion(soft).duration(), std::sqrt(10 / std::sqrt(3.0) * 0.5 / 2), 0.01 * 1.2);
  const PoseMotion straight = motion(slow);
  for (int k = 0; k <= 20; ++k) {
    const Pose X = straight.sample(straight.duration() * k / 20).X;
    const double share = X.position.norm() / 0.5;
    EXPECT_LT((X.position - share * goal.position).norm(), 1e-12);
    EXPECT_LT(pose_error(X, {exp_rotation(share * Vector3(0, 0.6, 0.8)), X.position}).norm(), 1e-9);
  }
}

TEST(PoseViaMotion, IsTheSameInEveryFrame) {
  Random random(23);
  const Pose start = random_pose(random, 0.4, 1), X_W = random_pose(random, 2, 3);
  std::vector<Pose> via, moved;
  for (int k = 0; k < 5; ++k) {
    via.push_back(random_pose(random, 0.4, 1));
    moved.push_back(X_W * via.back());
  }
  const PoseMotion here = pose_via_motion(resting(start), via, {}),
                   there = pose_via_motion(resting(X_W * start), moved, {});
  ASSERT_NEAR(here.duration(), there.duration(), 1e-9 * here.duration());
  for (int k = 0; k < 200; ++k) {
    const double t = here.duration() * k / 200;
    EXPECT_LT(pose_error(X_W * here.sample(t).X, there.sample(t).X).norm(), 1e-7);
  }
}

TEST(PoseViaMotion, StopsWhereItReversesButNotInABend) {
  const auto at = [](double x, double y) { return Pose{Matrix3::Identity(), Vector3(x, y, 0)}; };
  const std::vector<Pose> bend{at(0.3, 0), at(0.55, 0.15)}, back{at(0.3, 0), at(0, 0)};
  const PoseMotion round = pose_via_motion(resting(Pose{}), bend, {}),
                   fro = pose_via_motion(resting(Pose{}), back, {});
  EXPECT_GT(round.sample(round.knots()[0]).V.linear().norm(), 0.1);
  EXPECT_LT(fro.sample(fro.knots()[0]).V.linear().norm(), 1e-12);
}

TEST(PoseBrake, StopsWithinLimitsFromAnyState) {
  Random random(29);
  const PoseMotionLimits limits;
  for (int trial = 0; trial < 60; ++trial) {
    PoseSample from{random_pose(random, 1, 3), {}, {}};
    from.V.linear() = in_ball(random, limits.speed);
    from.V.angular() = in_ball(random, limits.angular_speed);
    from.A.linear() = in_ball(random, 0.5 * limits.acceleration);
    from.A.angular() = in_ball(random, 0.5 * limits.angular_acceleration);
    const PoseMotion motion = pose_brake(from, limits);
    EXPECT_LT((motion.sample(0).V.vector - from.V.vector).norm(), 1e-12);
    EXPECT_LT((motion.sample(0).A.vector - from.A.vector).norm(), 1e-12);
    EXPECT_LT(motion.sample(motion.duration() - 1e-9).V.vector.norm(), 1e-5);
    EXPECT_LT(motion.duration(), 1.0);
    const Seen seen = look(motion, limits, 1);
    EXPECT_LE(seen.acceleration, 1.001);
    EXPECT_LE(seen.angular_acceleration, 1.001);
    EXPECT_LE(seen.jerk, 1.02);
    EXPECT_LE(seen.angular_jerk, 1.02);
    EXPECT_LE(seen.twist_error, 2e-4);
  }
}

TEST(PoseViaMotion, MovingStartBrakesFirst) {
  PoseSample from = resting(Pose{});
  from.V.vector << 0.2, 0.1, 0, 0, 0.3, 0;
  const Pose goal{exp_rotation({0.5, 0, 0}), Vector3(0.2, 0.2, 0.2)};
  const PoseMotion motion = pose_via_motion(from, {&goal, 1}, {});
  EXPECT_LT((motion.sample(0).V.vector - from.V.vector).norm(), 1e-12);
  EXPECT_LT(pose_error(motion.sample(motion.duration()).X, goal).norm(), 1e-9);
  const Seen seen = look(motion, {}, 1);
  EXPECT_LE(std::max({seen.speed, seen.acceleration, seen.turning, seen.angular_acceleration}), 1.001);
  EXPECT_LE(seen.twist_error, 2e-4);
}

TEST(PoseMotionRefusals, NameTheExpectedInput) {
  const auto expect = [](auto&& work, const std::string& part) {
    try {
      work();
      ADD_FAILURE() << "not refused; expected '" << part << "'";
    } catch (const std::invalid_argument& error) {
      EXPECT_NE(std::string(error.what()).find(part), std::string::npos) << error.what();
    }
  };
  const auto plan = [](const Pose& goal, PoseMotionLimits limits = {}, double scale = 1) {
    return [=] { (void)pose_via_motion(PoseSample{}, std::vector{goal}, limits, scale); };
  };
  expect(plan({exp_rotation({3.14, 0, 0}), Vector3::Zero()}), "add a via point in between");
  expect(plan({2 * Matrix3::Identity(), Vector3::Zero()}), "via point 1: expected a rotation");
  expect(plan({Matrix3::Identity(), Vector3(0, std::nan(""), 0)}), "finite");
  expect(plan(Pose{}, {.speed = 0}), "above 0");
  expect(plan(Pose{}, {}, 0), "scale");
  expect([] { (void)pose_via_motion(PoseSample{}, {}, {}); }, "at least one");
}

}  // namespace
}  // namespace multipanda::pose_motion_test
