#include "motion_generators/circular_field/planner.hpp"

#include <numbers>
#include <stdexcept>

#include <gtest/gtest.h>

#include "core/testing/series.hpp"
#include "motion_generators/testing/seeded_course.hpp"

namespace multipanda::circular_field::planner_test {
namespace {

constexpr double kDt = 1e-3;

// The result of 20 s of a course, from the published poses alone.
struct Outcome {
  double finished_s = -1;
  double clearance = 1, speed = 0, acceleration = 0, jerk = 0, angular_speed = 0, work = 0, largest_force = 0;
};

Outcome follow(const Course& course, double seconds) {
  std::vector<Pose> starts;
  for (const auto& hand : course.hands) starts.push_back(*hand.start);
  CourseRun run(course, starts);
  Outcome outcome;
  const std::size_t hands = starts.size();
  std::vector<Pose> before = starts;
  std::vector<Vector3> velocity(hands, Vector3::Zero()), acceleration(hands, Vector3::Zero());
  for (int k = 0; k < static_cast<int>(seconds / kDt); ++k) {
    run.step(kDt);
    std::vector<Pose> now;
    for (std::size_t i = 0; i < hands; ++i) {
      const HandState& hand = run.planner().hand(i);
      now.push_back(hand.X_W);
      outcome.work = std::max(outcome.work, std::abs(hand.obstacle_force.dot(hand.velocity_before)));
      outcome.largest_force = std::max(outcome.largest_force, hand.obstacle_force.norm());
      const Vector3 v = (now[i].position - before[i].position) / kDt, a = (v - velocity[i]) / kDt;
      outcome.speed = std::max(outcome.speed, v.norm());
      outcome.acceleration = std::max(outcome.acceleration, a.norm());
      outcome.jerk = std::max(outcome.jerk, (a - acceleration[i]).norm() / kDt);
      outcome.angular_speed = std::max(
          outcome.angular_speed, log_rotation(now[i].rotation * before[i].rotation.transpose()).norm() / kDt);
      velocity[i] = v;
      acceleration[i] = a;
      for (const auto& obstacle : course.obstacles) {
        const Ball ball = obstacle.at(run.time());
        outcome.clearance = std::min(outcome.clearance, (ball.position - now[i].position).norm() -
                                                            ball.radius - course.hands[i].spec.radius);
      }
      for (std::size_t j = 0; j < i; ++j) {
        outcome.clearance =
            std::min(outcome.clearance, (now[j].position - now[i].position).norm() -
                                            course.hands[i].spec.radius - course.hands[j].spec.radius);
      }
    }
    before = now;
    if (outcome.finished_s < 0 && run.finished()) outcome.finished_s = run.time();
  }
  return outcome;
}

// Two hundred scenes with --full, otherwise the first twenty. Each has two hands and five obstacles that move
// at up to 0.1 m/s, and lasts 20 s, including the time after the goals are reached.
TEST(Planner, ReachesGoalsAroundMovingObstaclesWithoutTouching) {
  test::Series series;
  for (std::uint32_t seed = 1; seed <= 200; ++seed) {
    if (!series.takes(seed <= 20)) continue;
    const Outcome outcome = follow(seeded_course(seed), 20);
    series.record("reached", outcome.finished_s > 0);
    series.record("clearance_m", outcome.clearance);
    series.record("force_n", outcome.largest_force);
    EXPECT_GE(outcome.clearance, 0.02) << seed;  // the course requires 0.03
    EXPECT_LE(outcome.speed, 0.5 + 1e-9) << seed;
    EXPECT_LE(outcome.acceleration, 12) << seed;
    EXPECT_LE(outcome.jerk, 200 * 1.001) << seed;
    EXPECT_LE(outcome.angular_speed, 1.0 + 1e-9) << seed;
    EXPECT_LE(outcome.work, 1e-9) << seed;
  }
  if (!series.whole()) return;
  EXPECT_GE(series.sum("reached"), 0.99 * static_cast<double>(series.size()));
  EXPECT_GT(series.largest("force_n"), 1.0);  // the fields acted
}

TEST(Planner, SeededScenesHaveTheDocumentedProperties) {
  for (std::uint32_t seed = 1; seed <= 200; ++seed) {
    const Course course = seeded_course(seed);
    ASSERT_EQ(course.obstacles.size(), 5u);
    ASSERT_EQ(course.hands.size(), 2u);
    double fastest = 0;
    for (const auto& obstacle : course.obstacles) {
      for (double t = 0; t < 20; t += 0.01) {
        const double speed = (obstacle.at(t + 1e-4).position - obstacle.at(t - 1e-4).position).norm() / 2e-4;
        fastest = std::max(fastest, speed);
        ASSERT_NEAR(speed, obstacle.at(t).velocity.norm(), 1e-6);
      }
    }
    EXPECT_LE(fastest, 0.1 + 1e-6) << seed;
    EXPECT_GE(fastest, 0.02 - 1e-6) << seed;
    for (const auto& hand : course.hands)
      EXPECT_GE((hand.goals[0].position - hand.start->position).norm(), 0.3);
  }
}

Course one_hand(double turn_rate) {
  Course course;
  course.name = "head_on";
  CourseHand hand;
  hand.spec = {"hand", 0.08, {}};
  hand.start = Pose{};
  hand.goals = {Pose{Matrix3::Identity(), {0.8, 0, 0}}};
  course.hands.push_back(hand);
  course.obstacles = {{.name = "ball", .radius = 0.1, .position = {0.4, 0, 0}}};
  course.gains.turn_rate = turn_rate;
  return course;
}

// Repulsion cannot pass an obstacle that is exactly in the way. A circular field can.
TEST(Planner, CircularFieldsPassWhereRepulsionStops) {
  const Outcome with = follow(one_hand(12), 10), without = follow(one_hand(1e-9), 10);
  EXPECT_GT(with.finished_s, 0);
  EXPECT_LT(with.finished_s, 6);
  EXPECT_LT(without.finished_s, 0);
  EXPECT_GE(without.clearance, 0.02);
}

TEST(Planner, TwoHandsThatMeetHeadOnPassEachOther) {
  Course course = one_hand(12);
  course.obstacles.clear();
  CourseHand other = course.hands[0];
  other.spec.name = "other";
  std::swap(*other.start, other.goals[0]);
  course.hands.push_back(other);
  const Outcome outcome = follow(course, 10);
  EXPECT_GT(outcome.finished_s, 0);
  EXPECT_GE(outcome.clearance, 0.02);
}

TEST(Planner, WaitingHandAvoidsAndReturns) {
  Course course = one_hand(12);
  course.hands[0].goals = {Pose{}};
  course.obstacles = {{.name = "ball", .radius = 0.1, .position = {0.5, 0, 0}, .velocity = {-0.1, 0, 0}}};
  std::vector<Pose> start{Pose{}};
  CourseRun run(course, start);
  double farthest = 0, least = 1;
  for (int k = 0; k < 20'000; ++k) {
    run.step(kDt);
    farthest = std::max(farthest, run.planner().hand(0).X_W.position.norm());
    least = std::min(least, run.clearance());
  }
  EXPECT_GT(farthest, 0.1);  // the ball passed over the goal
  EXPECT_GE(least, 0.02);
  EXPECT_LT(run.planner().hand(0).X_W.position.norm(), 0.005);
}

// Only the vertical direction is special in the law: a scene that is translated and rotated about it gives a
// motion that is translated and rotated alike.
TEST(Planner, MotionRotatesWithTheScene) {
  Course course = seeded_course(7), turned = course;
  const Pose X{rotation_from_rpy({0, 0, 1.1}), {0.3, -0.2, 0.5}};
  for (Course* c : {&course, &turned}) {
    for (auto& hand : c->hands) hand.spec.workspace.clear();  // walls are aligned with the world's axes
  }
  for (auto& hand : turned.hands) {
    hand.start = X * *hand.start;
    hand.goals[0] = X * hand.goals[0];
  }
  for (auto& obstacle : turned.obstacles) {
    obstacle.position = X * obstacle.position;
    obstacle.velocity = X.rotation * obstacle.velocity;
    obstacle.amplitude = X.rotation * obstacle.amplitude;
  }
  CourseRun a(course, {*course.hands[0].start, *course.hands[1].start});
  CourseRun b(turned, {*turned.hands[0].start, *turned.hands[1].start});
  for (int k = 0; k < 3000; ++k) {
    a.step(kDt);
    b.step(kDt);
    for (std::size_t i = 0; i < 2; ++i) {
      const Pose expected = X * a.planner().hand(i).X_W, found = b.planner().hand(i).X_W;
      ASSERT_LT((expected.position - found.position).norm(), 1e-9) << k;
      ASSERT_LT((expected.rotation - found.rotation).norm(), 1e-9) << k;
    }
  }
}

TEST(Planner, BrakesToRest) {
  const Course course = seeded_course(3);
  CourseRun run(course, {*course.hands[0].start, *course.hands[1].start});
  for (int k = 0; k < 700; ++k) run.step(kDt);
  EXPECT_GT(run.planner().hand(0).velocity.norm(), 0.1);
  run.brake();
  for (int k = 0; k < 2000 && !run.at_rest(); ++k) run.step(kDt);
  EXPECT_TRUE(run.at_rest());
}

TEST(Planner, RefusesImpossibleSpecifications) {
  EXPECT_THROW(Planner({}, {}, {}), std::invalid_argument);
  EXPECT_THROW(Planner({{"a", 0, {}}}, {}, {}), std::invalid_argument);
  EXPECT_THROW(Planner({{"a", 0.1, {}}}, {.cruise = 0.6}, {}), std::invalid_argument);
  EXPECT_THROW(Planner({{"a", 0.1, {{{0, 0, 0}, {1, 1, 0.2}}}}}, {}, {}), std::invalid_argument);
}

}  // namespace
}  // namespace multipanda::circular_field::planner_test
