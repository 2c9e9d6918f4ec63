#include <numbers>

#include <gtest/gtest.h>

#include "core/reference/reference.hpp"
#include "core/testing/test_arm.hpp"

// A set-point while the frame that follows it is redefined, and targets that arrive faster than steps.
namespace multipanda::frame_change_test {
namespace {

using test::Draw;
constexpr double kDt = 0.001;

Reference pose_reference() { return Reference({.name = "pose", .quantity = Quantity::pose}, 7); }

// Poses of two references that are one rigid body: theirs is X away from ours.
double apart(const Reference& ours, const Pose& X, const Reference& theirs) {
  const Pose moved = ours.pose() * X;
  return (moved.position - theirs.pose().position).norm() +
         log_rotation(moved.rotation * theirs.pose().rotation.transpose()).norm();
}

// At rest, under way to a goal and while moving in a circle: position, velocity and acceleration after the
// change are those of the same rigid body, and the goal is the old one, seen from the new frame.
TEST(FrameChange, CarriesPoseVelocityAccelerationAndGoal) {
  Draw draw(31);
  for (int trial = 0; trial < 30; ++trial) {
    const Pose X = draw.pose(0.2), start = draw.pose(0.5);
    Reference ours = pose_reference(), theirs = pose_reference();
    const Pose goal{exp_rotation(draw.vector3(0.6)) * start.rotation, start.position + draw.vector3(0.2)};
    Target circle{.delivery = Delivery::motion, .size = 3, .period_s = 2};
    circle.values = {0.02, 0.05, 0};
    circle.sine = {0.03, 0, 0.04};
    for (Reference* each : {&ours, &theirs}) {
      each->start(start);
      if (trial % 3 == 1) each->set(pose_target(goal, 1.5));
      if (trial % 3 == 2) each->set(circle);
      for (int k = 0; k < 600; ++k) each->advance(kDt, k * kDt);
    }
    theirs.carry(X);
    EXPECT_NEAR(apart(ours, X, theirs), 0, 1e-12);
    // Velocity and acceleration of E_new, by differences of the poses that the old reference gives next.
    const Vector3 r = ours.pose().rotation * X.position;
    const Vector3 omega = ours.twist().angular(), alpha = ours.acceleration().angular();
    EXPECT_NEAR((theirs.twist().angular() - omega).norm(), 0, 1e-12);
    const Pose before = ours.pose() * X;
    const Vector3 v = theirs.twist().linear(), a = theirs.acceleration().linear();
    ours.advance(kDt, 1);
    const Vector3 difference = ((ours.pose() * X).position - before.position) / kDt;
    EXPECT_NEAR((difference - v - 0.5 * kDt * a).norm(), 0,
                1e-3 * (omega.norm() + alpha.norm() * r.norm()) + 1e-4);
    for (int k = 0; k < 6000; ++k) {
      ours.advance(kDt, 1 + k * kDt);
      theirs.advance(kDt, 1 + k * kDt);
    }
    EXPECT_NEAR(apart(ours, X, theirs), 0, 1e-9);
    EXPECT_EQ(theirs.twist().vector.norm(), 0);
  }
}

// Position and velocity are continuous, within the speed limits of the input, at any moment of the motion.
TEST(FrameChange, IsContinuousInMidMotion) {
  Draw draw(32);
  for (int trial = 0; trial < 20; ++trial) {
    const Pose X = draw.pose(0.15);
    Reference reference = pose_reference();
    reference.start(draw.pose(0.5));
    const Pose goal{exp_rotation(draw.vector3(0.5)) * reference.pose().rotation,
                    reference.pose().position + draw.vector3(0.3)};
    reference.set(pose_target(goal));
    const int change = static_cast<int>(draw.index(900));
    Vector3 p = Vector3::Zero(), v = Vector3::Zero();
    for (int k = 0; k < 3000; ++k) {
      if (k == change) {
        reference.carry(X);
        p = reference.pose().position;
        v = reference.twist().linear();
      }
      reference.advance(kDt, k * kDt);
      if (k < change) continue;
      const Vector3 v_now = reference.twist().linear();
      EXPECT_NEAR((reference.pose().position - p - 0.5 * kDt * (v + v_now)).norm(), 0, 2e-6);
      EXPECT_LT((v_now - v).norm(), 0.012);  // 12 m/s^2: 4 of the goal, and of the turn about the new frame
      p = reference.pose().position;
      v = v_now;
    }
    EXPECT_NEAR((p - (goal * X).position).norm(), 0, 1e-9);
  }
}

// The next sample of a stream, which still means the old frame, is approached within the speed limits.
TEST(FrameChange, AStreamDoesNotJump) {
  Reference reference = pose_reference();
  reference.start(Pose{});
  const Pose X{Matrix3::Identity(), Vector3(0, 0, 0.15)};
  double fastest = 0;
  Vector3 p = Vector3::Zero();
  for (int k = 0; k < 2000; ++k) {
    const double t = k * kDt;
    if (k % 10 == 0) {
      const Pose sample{Matrix3::Identity(), Vector3(0.05 * std::sin(t), 0, 0)};
      ASSERT_EQ(reference.post(pose_target(sample, 0, Delivery::stream)), Verdict::accepted);
    }
    if (k == 1000) {
      reference.carry(X);
      EXPECT_NEAR((reference.pose().position - p - X.position).norm(), 0, 1e-12);
      p = reference.pose().position;
    }
    reference.advance(kDt, t);
    fastest = std::max(fastest, (reference.pose().position - p).norm() / kDt);
    p = reference.pose().position;
  }
  EXPECT_LT(fastest, 1.1 * 0.5);
  EXPECT_NEAR(p.z(), 0, 1e-6);  // the sender decides
}

TEST(FrameChange, OtherQuantitiesStay) {
  Reference joints({.name = "joints", .quantity = Quantity::joints}, 3);
  joints.start(JointVector(Vector3(1, 2, 3)));
  joints.carry(Pose{rotation_from_rpy({0.1, 0.2, 0.3}), Vector3(1, 1, 1)});
  joints.advance(kDt, 0);
  EXPECT_EQ(joints.joints(), JointVector(Vector3(1, 2, 3)));
}

// However many goals arrive before a step, one motion is planned: to the newest.
TEST(ManyGoals, OnlyTheNewestOfAStepIsPlanned) {
  Draw draw(33);
  Reference many = pose_reference(), one = pose_reference();
  const Pose start = draw.pose(0.5);
  many.start(start);
  one.start(start);
  for (int k = 0; k < 300; ++k) {
    Pose goal;
    for (int i = 0; i < 64; ++i) {
      goal = {start.rotation, start.position + draw.vector3(0.2)};
      many.set(pose_target(goal));
    }
    one.set(pose_target(goal));
    many.advance(kDt, k * kDt);
    one.advance(kDt, k * kDt);
    ASSERT_EQ(many.pose().position, one.pose().position);
    ASSERT_EQ(many.planned(), static_cast<std::uint64_t>(k + 1));
  }
  // A posted target is newer than one of the loop's own schedule.
  const std::uint64_t before = many.planned();
  many.set(pose_target(start));
  ASSERT_EQ(many.post(pose_target(start)), Verdict::accepted);
  many.advance(kDt, 1);
  EXPECT_EQ(many.planned(), before + 1);
  // A start discards what was not planned yet.
  many.set(pose_target(draw.pose(0.5)));
  many.start(start);
  many.advance(kDt, 2);
  EXPECT_EQ(many.pose().position, start.position);
}

}  // namespace
}  // namespace multipanda::frame_change_test
