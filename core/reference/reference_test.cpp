#include "core/reference/reference.hpp"

#include <atomic>
#include <limits>
#include <numbers>
#include <thread>

#include <gtest/gtest.h>

#include "core/testing/test_arm.hpp"

namespace multipanda::reference_test {
namespace {

using test::Draw;
constexpr double kDt = 0.001;

Target joint_target(const JointVector& q, Delivery delivery = Delivery::goal) {
  Target target;
  target.delivery = delivery;
  target.size = static_cast<std::uint8_t>(q.size());
  std::copy_n(q.data(), q.size(), target.values.begin());
  return target;
}

// Runs a reference and checks at every step that position, velocity and acceleration are derivatives of each
// other: a jump in one of them would be a large one in its difference quotient.
class Watch {
 public:
  explicit Watch(Reference& reference) : reference_(reference) { remember(); }

  void step() {
    now_ += kDt;
    reference_.advance(kDt, now_);
    if (reference_.spec().quantity == Quantity::pose) {
      const Pose& X = reference_.pose();
      Vector6 moved;
      moved << X.position - X_.position, log_rotation(X.rotation * X_.rotation.transpose());
      check(moved, V_, reference_.twist().vector, A_, reference_.acceleration().vector);
      speed = std::max(speed, reference_.twist().linear().norm());
      acceleration = std::max(acceleration, reference_.acceleration().linear().norm());
      angular_acceleration = std::max(angular_acceleration, reference_.acceleration().angular().norm());
      angular_speed = std::max(angular_speed, reference_.twist().angular().norm());
    } else {
      const JointVector moved = reference_.joints() - q_;
      check(moved, dq_, reference_.joint_velocity(), ddq_, reference_.joint_acceleration());
      speed = std::max(speed, reference_.joint_velocity().lpNorm<Eigen::Infinity>());
      acceleration = std::max(acceleration, reference_.joint_acceleration().lpNorm<Eigen::Infinity>());
    }
    remember();
  }
  void steps(int count) {
    for (int k = 0; k < count; ++k) step();
  }
  double now() const { return now_; }

  double speed = 0, angular_speed = 0;
  double acceleration = 0, angular_acceleration = 0;
  double position_gap = 0;      // worst of |dx - (v0 + v1)/2 dt|
  double velocity_gap = 0;      // worst of |dv - (a0 + a1)/2 dt|
  double acceleration_gap = 0;  // largest change of acceleration in one step

 private:
  template <typename Vector>
  void check(const Vector& moved, const Vector& v0, const Vector& v1, const Vector& a0, const Vector& a1) {
    position_gap = std::max(position_gap, (moved - 0.5 * kDt * (v0 + v1)).norm());
    velocity_gap = std::max(velocity_gap, (v1 - v0 - 0.5 * kDt * (a0 + a1)).norm());
    acceleration_gap = std::max(acceleration_gap, (a1 - a0).norm());
  }
  void remember() {
    X_ = reference_.pose();
    V_ = reference_.twist().vector;
    A_ = reference_.acceleration().vector;
    q_ = reference_.joints();
    dq_ = reference_.joint_velocity();
    ddq_ = reference_.joint_acceleration();
  }
  Reference& reference_;
  double now_ = 0;
  Pose X_;
  Vector6 V_, A_;
  JointVector q_, dq_, ddq_;
};

Reference pose_reference() { return Reference({.name = "pose", .quantity = Quantity::pose}, 7); }
Reference joint_reference() { return Reference({.name = "joints", .quantity = Quantity::joints}, 7); }

TEST(Quintic, MeetsItsBoundaryConditions) {
  Draw draw(1);
  for (int k = 0; k < 200; ++k) {
    QuinticSegment::Sample start, at;
    QuinticSegment::Values goal{}, velocity{};
    start.position[0] = draw.uniform(-1, 1);
    start.velocity[0] = draw.uniform(-1, 1);
    start.acceleration[0] = draw.uniform(-5, 5);
    goal[0] = draw.uniform(-1, 1);
    velocity[0] = draw.uniform(-1, 1);
    const double T = draw.uniform(0.05, 3);
    QuinticSegment segment;
    segment.plan(1, start, goal, T, velocity);
    segment.evaluate(0, at);
    EXPECT_EQ(at.position[0], start.position[0]);
    EXPECT_EQ(at.velocity[0], start.velocity[0]);
    EXPECT_EQ(at.acceleration[0], start.acceleration[0]);
    segment.evaluate(T * (1 - 1e-12), at);
    EXPECT_NEAR(at.position[0], goal[0], 1e-9);
    EXPECT_NEAR(at.velocity[0], velocity[0], 1e-8);
    EXPECT_NEAR(at.acceleration[0], 0, 1e-5);
  }
}

TEST(Reference, StartsAtRestWhereTheMeasurementIs) {
  Draw draw(2);
  Reference reference = pose_reference();
  const Pose X = draw.pose(1);
  ASSERT_EQ(reference.post(pose_target(draw.pose(1))), Verdict::accepted);  // older than the start: discarded
  reference.start(X);
  for (int k = 0; k < 10; ++k) reference.advance(kDt, k * kDt);
  EXPECT_LT((reference.pose().position - X.position).norm(), 1e-15);
  EXPECT_LT((reference.pose().rotation - X.rotation).norm(), 1e-14);
  EXPECT_EQ(reference.twist().vector.norm(), 0);
}

TEST(Reference, ReachesAGoalExactlyWithinTheSpeedLimits) {
  Draw draw(3);
  for (int k = 0; k < 20; ++k) {
    Reference reference = pose_reference();
    reference.start(draw.pose(0.5));
    Watch watch(reference);
    const Pose goal = draw.pose(0.5);
    ASSERT_EQ(reference.post(pose_target(goal)), Verdict::accepted);
    watch.steps(9000);
    EXPECT_LT((reference.pose().position - goal.position).norm(), 1e-15);
    EXPECT_LT((reference.pose().rotation - goal.rotation).norm(), 1e-12);
    EXPECT_EQ(reference.twist().vector.norm(), 0);
    EXPECT_LE(watch.speed, 0.5 * 1.001);
    EXPECT_LE(watch.angular_speed, 1.0 * 1.001);
    EXPECT_LT(watch.position_gap, 1e-5);
    EXPECT_LT(watch.velocity_gap, 1e-4);
    EXPECT_FALSE(reference.stale());
  }
}

// Goals that follow each other before they are reached: the set-point reverses smoothly, and short motions
// cause no torque spike. (Sampled at a finite number of points, the limit is kept to some percent.)
TEST(Reference, GoalsInMidMotionChangeItSmoothly) {
  Draw draw(4);
  for (int k = 0; k < 50; ++k) {
    Reference reference = pose_reference();
    const Pose home = draw.pose(0.5);
    reference.start(home);
    Watch watch(reference);
    Pose there = home;
    for (int goals = 0; goals < 10; ++goals) {
      there.position = home.position + draw.vector3(goals % 3 == 0 ? 0.02 : 0.1);
      there.rotation = exp_rotation(draw.vector3(0.3)) * home.rotation;
      ASSERT_EQ(reference.post(pose_target(there)), Verdict::accepted);
      watch.steps(1 + static_cast<int>(draw.uniform(0, 400)));
    }
    watch.steps(3000);
    EXPECT_LT((reference.pose().position - there.position).norm(), 1e-12);
    EXPECT_LE(watch.acceleration, 4 * 1.03);
    EXPECT_LE(watch.angular_acceleration,
              8 * 1.1);  // its rate is that of a rotation vector up to large angles
    EXPECT_LE(watch.speed, 0.5 * 1.01);
  }
  for (int k = 0; k < 50; ++k) {
    Reference reference({.name = "joints", .quantity = Quantity::joints, .max_speed = 2}, 7);
    reference.start(joint_constant(7, 0));
    Watch watch(reference);
    for (int goals = 0; goals < 10; ++goals) {
      ASSERT_EQ(reference.post(joint_target(joint_constant(7, draw.uniform(-0.5, 0.5)))), Verdict::accepted);
      watch.steps(1 + static_cast<int>(draw.uniform(0, 400)));
    }
    EXPECT_LE(watch.acceleration, 5 * 1.03);
  }
}

TEST(Reference, TakesTheRequestedTime) {
  Reference reference = joint_reference();
  reference.start(joint_constant(7, 0));
  Target target = joint_target(joint_constant(7, 0.1));
  target.duration_s = 2;
  ASSERT_EQ(reference.post(target), Verdict::accepted);
  Watch watch(reference);
  watch.steps(1000);
  EXPECT_NEAR(reference.joints()[3], 0.05, 1e-12);  // half of the way after half of the time
  watch.steps(1001);
  EXPECT_EQ(reference.joints()[3], 0.1);
}

TEST(Reference, StaysSmoothWhenGoalsChangeWhileMoving) {
  Draw draw(4);
  for (int k = 0; k < 10; ++k) {
    Reference reference = pose_reference();
    reference.start(draw.pose(0.3));
    Watch watch(reference);
    for (int goals = 0; goals < 20; ++goals) {
      ASSERT_EQ(reference.post(pose_target(draw.pose(0.3))), Verdict::accepted);
      watch.steps(50 + static_cast<int>(draw.index(900)));
    }
    EXPECT_LT(watch.position_gap, 2e-5);
    EXPECT_LT(watch.velocity_gap, 1e-3);
    EXPECT_LT(watch.acceleration_gap, 3);
    EXPECT_LE(watch.speed, 0.5 * 1.33);  // Reference says where the excess comes from
    EXPECT_LE(watch.angular_speed, 1.0 * 1.33);
  }
}

// Each in mid-motion, many against it: none may raise the speed that the next one finds.
TEST(Reference, GoalsInQuickSuccessionKeepToTheSpeed) {
  for (const bool pose : {true, false}) {
    for (const int every : {20, 50, 100, 200, 350}) {
      for (const std::uint32_t seed : {0U, 1U, 2U}) {  // 0: back and forth
        Reference reference({.name = "input", .quantity = pose ? Quantity::pose : Quantity::joints}, 7);
        pose ? reference.start(Pose{}) : reference.start(joint_constant(7, 0));
        test::Draw draw(seed);
        double fastest = 0, turning = 0;
        for (int k = 0; k < 8000; ++k) {
          if (k % every == 0) {
            const double side = k / every % 2 == 0 ? 0.5 : -0.5;
            Pose X{rotation_from_rpy({0, side, 0}), {0, side, 0}};
            if (seed != 0) X = {exp_rotation(draw.vector3(0.5)), draw.vector3(0.5)};
            Target target = pose_target(X);
            if (!pose) {
              target.size = 7;
              for (double& value : target.values) value = seed == 0 ? side : draw.uniform(-0.5, 0.5);
            }
            ASSERT_EQ(reference.post(target), Verdict::accepted);
          }
          reference.advance(1e-3, 1e-3 * k);
          fastest = std::max(fastest, pose ? reference.twist().linear().norm()
                                           : reference.joint_velocity().cwiseAbs().maxCoeff());
          if (pose) turning = std::max(turning, reference.twist().angular().norm());
        }
        SCOPED_TRACE((pose ? "pose, every " : "joints, every ") + std::to_string(every) + " ms, seed " +
                     std::to_string(seed));
        EXPECT_LE(fastest, 1.02 * reference.spec().max_speed);
        EXPECT_LE(turning, 1.02 * reference.spec().max_angular_speed);
      }
    }
  }
}

TEST(Reference, AGoalUnderTheMovingSetPointStopsItSmoothly) {
  Reference reference = joint_reference();
  reference.start(joint_constant(7, 0));
  Watch watch(reference);
  ASSERT_EQ(reference.post(joint_target(joint_constant(7, 1))), Verdict::accepted);
  watch.steps(1500);
  const JointVector here = reference.joints();
  ASSERT_GT(reference.joint_velocity()[0], 0.2);
  ASSERT_EQ(reference.post(joint_target(here)), Verdict::accepted);
  watch.steps(1000);
  EXPECT_LT(watch.acceleration_gap, 6);  // of seven joints: 36 v/T^2 dt each at most, v = 0.5, T = 0.1
  EXPECT_LT(watch.velocity_gap, 1e-3);
  EXPECT_EQ(reference.joints(), here);
}

TEST(Reference, ASmallGoalCausesNoTorqueSpike) {
  Reference reference = joint_reference();
  reference.start(joint_constant(7, 0));
  ASSERT_EQ(reference.post(joint_target(joint_constant(7, 0.001))), Verdict::accepted);
  double worst = 0;
  for (int k = 0; k < 200; ++k) {
    reference.advance(kDt, k * kDt);
    worst = std::max(worst, reference.joint_acceleration().lpNorm<Eigen::Infinity>());
  }
  EXPECT_LT(worst, 1.0);  // 5.8 d/T^2 with T = 0.1 s
  EXPECT_EQ(reference.joints()[0], 0.001);
}

TEST(Reference, TakesTheShorterRotationForEitherQuaternionSign) {
  const Matrix3 start = Eigen::AngleAxisd(0.2, Vector3::UnitZ()).toRotationMatrix();
  for (const double sign : {1.0, -1.0}) {
    for (const double angle : {0.5, 3.0, -3.0, 6.0}) {
      Reference reference = pose_reference();
      reference.start(Pose{start, Vector3::Zero()});
      const Matrix3 goal = Eigen::AngleAxisd(angle, Vector3(0.6, 0, 0.8)).toRotationMatrix() * start;
      Target target = pose_target(Pose{goal, Vector3::Zero()});
      for (std::size_t i = 3; i < 7; ++i) target.values[i] *= sign;
      ASSERT_EQ(reference.post(target), Verdict::accepted);
      double traveled = 0;
      for (int k = 0; k < 7000; ++k) {
        reference.advance(kDt, k * kDt);
        traveled += reference.twist().angular().norm() * kDt;
      }
      const double shortest = std::min(std::abs(angle), 2 * std::numbers::pi - std::abs(angle));
      EXPECT_NEAR(traveled, shortest, 1e-3);
      EXPECT_LT((reference.pose().rotation - goal).norm(), 1e-12);
    }
  }
}

// A smooth path, sampled in different ways; the set-point follows it at most a few periods late.
Pose path(double t) {
  return {exp_rotation(Vector3(0.4 * std::sin(0.9 * t), 0.3 * std::cos(t), 0.2 * t)),
          Vector3(0.1 * std::sin(1.5 * t), 0.1 * std::cos(1.1 * t), 0.02 * t)};
}

struct Feed {
  const char* name;
  double period, jitter, loss;
  double lag;  // allowed, in seconds along the path
};
class StreamTest : public testing::TestWithParam<Feed> {};

TEST_P(StreamTest, IsFollowedSmoothly) {
  const Feed feed = GetParam();
  Draw draw(6);
  Reference reference = pose_reference();
  reference.start(path(0));
  Watch watch(reference);
  double next = 0, worst = 0, worst_turn = 0;
  for (int k = 0; k < 8000; ++k) {
    if (watch.now() + 1e-9 >= next) {
      Target target = pose_target(path(watch.now()), 0, Delivery::stream);
      if (draw.coin()) {
        for (std::size_t i = 3; i < 7; ++i) target.values[i] *= -1;
      }
      if (draw.uniform(0, 1) >= feed.loss) {
        ASSERT_EQ(reference.post(target), Verdict::accepted);
      }
      next = watch.now() + feed.period + draw.uniform(0, feed.jitter);
    }
    watch.step();
    if (k < 1000) {
      watch.acceleration_gap = watch.velocity_gap = watch.position_gap = 0;
      continue;
    }
    EXPECT_FALSE(reference.stale());
    worst = std::max(worst, (reference.pose().position - path(watch.now()).position).norm());
    worst_turn = std::max(
        worst_turn, log_rotation(reference.pose().rotation * path(watch.now()).rotation.transpose()).norm());
  }
  RecordProperty("position_error_um", static_cast<int>(1e6 * worst));
  EXPECT_LT(worst, 0.19 * feed.lag);       // the path's speed stays below 0.19 m/s
  EXPECT_LT(worst_turn, 0.55 * feed.lag);  // and 0.55 rad/s
  EXPECT_LE(watch.speed, 0.5 * 1.06);
  EXPECT_LT(watch.position_gap, 1e-4);
  EXPECT_LT(watch.velocity_gap, 0.02);
}

INSTANTIATE_TEST_SUITE_P(Feeds, StreamTest,
                         testing::Values(Feed{"1 kHz", 0.001, 0, 0, 0.004},
                                         Feed{"100 Hz", 0.010, 0, 0, 0.022},
                                         Feed{"100 Hz, jitter of 4 ms", 0.008, 0.004, 0, 0.030},
                                         Feed{"1 kHz, a tenth lost", 0.001, 0, 0.1, 0.008},
                                         Feed{"100 Hz, a tenth lost", 0.010, 0, 0.1, 0.060}),
                         [](const auto& feed) { return "Feed" + std::to_string(feed.index); });

TEST(Stream, ALateSampleIsBridgedAndSilenceIsStale) {
  Reference reference = joint_reference();
  reference.start(joint_constant(7, 0));
  Watch watch(reference);
  const auto send = [&] {
    ASSERT_EQ(reference.post(joint_target(joint_constant(7, 0.2 * watch.now()), Delivery::stream)),
              Verdict::accepted);
  };
  for (int k = 0; k < 200; ++k) {
    if (k % 10 == 0) send();
    watch.step();
  }
  watch.steps(60);  // six samples are missing
  EXPECT_FALSE(reference.stale());
  EXPECT_TRUE(reference.streaming());
  for (int k = 0; k < 200; ++k) {
    if (k % 10 == 0) send();
    watch.step();
    EXPECT_FALSE(reference.stale());
  }
  watch.steps(80);
  EXPECT_FALSE(reference.stale());
  watch.steps(30);
  EXPECT_TRUE(reference.stale());
  EXPECT_LT(watch.position_gap, 1e-4);
  EXPECT_LT(watch.velocity_gap, 0.02);
  watch.steps(200);
  EXPECT_EQ(reference.joint_velocity().norm(), 0);  // it came to a rest
}

// All joints near their speed at once: the limit is each joint's own, so no part of the series is delayed.
TEST(Stream, ManyJointsNearTheirSpeedAreFollowedWithoutLag) {
  Reference reference = joint_reference();
  const auto series = [](double t) { return joint_constant(7, 0.3 * (1 - std::cos(1.6 * t))); };
  reference.start(series(0));
  double worst = 0, worst_acceleration = 0;
  for (int k = 0; k < 4000; ++k) {
    const double t = k * kDt;
    Target target = joint_target(series(t));
    target.delivery = Delivery::stream;
    ASSERT_EQ(reference.post(target), Verdict::accepted);
    reference.advance(kDt, t);
    if (k < 500) continue;
    worst = std::max(worst, (reference.joints() - series(t)).lpNorm<Eigen::Infinity>());
    worst_acceleration =
        std::max(worst_acceleration, reference.joint_acceleration().lpNorm<Eigen::Infinity>());
  }
  EXPECT_LT(worst, 0.48 * 0.0025);                        // two periods late
  EXPECT_LT(worst_acceleration, 1.05 * 0.3 * 1.6 * 1.6);  // the series' own
}

TEST(Stream, AJumpInTheSeriesIsApproachedWithinTheSpeed) {
  Reference reference = joint_reference();
  reference.start(joint_constant(7, 0));
  Watch watch(reference);
  for (int k = 0; k < 5000; ++k) {
    ASSERT_EQ(reference.post(joint_target(joint_constant(7, k < 100 ? 0 : 1), Delivery::stream)),
              Verdict::accepted);
    watch.step();
  }
  EXPECT_LE(watch.speed, 0.5 * 1.06);
  EXPECT_NEAR(reference.joints()[0], 1, 1e-6);
}

TEST(Reference, RefusesInvalidTargets) {
  Reference reference = pose_reference();
  Target target = pose_target({});
  EXPECT_EQ(reference.post(target), Verdict::accepted);
  target.size = 6;
  EXPECT_EQ(reference.post(target), Verdict::wrong_size);
  target = pose_target({});
  target.values[1] = std::numeric_limits<double>::infinity();
  EXPECT_EQ(reference.post(target), Verdict::not_finite);
  target = pose_target({});
  target.values[3] = 1.2;
  EXPECT_EQ(reference.post(target), Verdict::out_of_bounds);
  target = pose_target({}, -1);
  EXPECT_EQ(reference.post(target), Verdict::out_of_bounds);
  target = pose_target({}, std::nan(""));
  EXPECT_EQ(reference.post(target), Verdict::not_finite);
  EXPECT_THROW(Reference({.name = "x", .max_speed = 0}, 7), std::invalid_argument);
}

TEST(Reference, IsPostedToFromManyThreads) {
  Reference reference = joint_reference();
  reference.start(joint_constant(7, 0));
  std::vector<std::thread> posters;
  std::atomic<int> running{3};
  for (int t = 0; t < 3; ++t) {
    posters.emplace_back([&, t] {
      for (int k = 0; k < 3000; ++k) {
        (void)reference.post(
            joint_target(joint_constant(7, 0.1 * t), k % 2 == 0 ? Delivery::stream : Delivery::goal));
      }
      --running;
    });
  }
  double now = 0;
  bool uniform = true;
  while (running > 0) {
    reference.advance(kDt, now += kDt);
    uniform = uniform && (reference.joints().array() == reference.joints()[0]).all();  // no target is torn
  }
  for (auto& poster : posters) poster.join();
  EXPECT_TRUE(uniform);
}

}  // namespace
}  // namespace multipanda::reference_test
