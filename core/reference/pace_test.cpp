#include <array>
#include <cmath>
#include <limits>
#include <tuple>

#include <gtest/gtest.h>

#include "core/model/arm_model.hpp"
#include "core/reference/reference.hpp"

// The pace of a set-point: it waits while the hand cannot follow, and keeps the hand
// within its speed.
namespace multipanda {
namespace {

constexpr double kDt = 1e-3;

Reference pose_reference(double max_speed = 0.25) {
  Reference reference({.name = "pose", .max_speed = max_speed}, 7);
  reference.start(Pose{rotation_from_rpy({0.3, -0.4, 0.7}), {0.4, -0.1, 0.3}});
  return reference;
}

Pose moved(const Reference& reference, const Vector3& by) {
  Pose X = reference.pose();
  X.position += by;
  return X;
}

TEST(Pace, WaitsWhilePulledToAndGoesOn) {
  Reference reference = pose_reference();
  const Pose start = reference.pose(), goal = moved(reference, {0.1, -0.2, -0.3});
  const Vector3 along = (goal.position - start.position).normalized();
  ASSERT_EQ(reference.post(pose_target(goal)), Verdict::accepted);
  Vector6 pull = Vector6::Zero();
  pull.head<3>() = 60 * along;
  double t = 0;
  const auto advance = [&](double share) {
    const Pose before = reference.pose();
    const Vector3 v = reference.twist().linear();
    reference.resist(pull, share, 0);
    reference.advance(kDt, t += kDt);
    // The velocity is that of the positions, and continuous.
    EXPECT_LT(((reference.pose().position - before.position) / kDt - reference.twist().linear()).norm(),
              0.01);
    EXPECT_LT((reference.twist().linear() - v).norm() / kDt, 6.0);
  };
  while (t < 0.6) advance(0);
  const double speed = reference.twist().linear().norm();
  EXPECT_GT(speed, 0.1);
  const Vector3 at = reference.pose().position;
  while (t < 1.1) advance(1.0);
  EXPECT_LT(reference.twist().linear().norm(), 1e-3);
  EXPECT_LT((reference.pose().position - at).norm(), 0.1 * speed);  // stopped within 2 e / bandwidth
  const Vector3 waiting = reference.pose().position;
  while (t < 6) advance(1.0);
  EXPECT_LT((reference.pose().position - waiting).norm(), 1e-3);
  while (t < 12) advance(0.1);
  EXPECT_LT((reference.pose().position - goal.position).norm(), 1e-9);
}

TEST(Pace, MovesAwayFromWhatItIsPulledTo) {
  Reference reference = pose_reference();
  const Pose goal = moved(reference, {0, 0, 0.2});
  ASSERT_EQ(reference.post(pose_target(goal)), Verdict::accepted);
  Vector6 pull = Vector6::Zero();
  pull.head<3>() << 0, 0, -60;
  for (int k = 1; k < 3000; ++k) {
    reference.resist(pull, 2, 0);
    reference.advance(kDt, kDt * k);
  }
  EXPECT_LT((reference.pose().position - goal.position).norm(), 1e-9);
  EXPECT_EQ(reference.pace(), 1);
}

// Two hands follow one set-point, and something between them pulls them in opposite directions, the stronger
// one against the motion.
TEST(Pace, WaitsForTheHandThatTheMotionLoadsAlsoIfTheOtherIsPulledHarder) {
  for (const bool stronger_first : {true, false}) {
    Reference reference = pose_reference();
    const Vector3 start = reference.pose().position;
    ASSERT_EQ(reference.post(pose_target(moved(reference, {0, 0.3, 0}))), Verdict::accepted);
    Vector6 along = Vector6::Zero();
    along[1] = 60;
    for (int k = 1; k < 2000; ++k) {
      if (stronger_first) reference.resist(-along, 1.5, 0);
      reference.resist(along, 1.0, 0);
      if (!stronger_first) reference.resist(-along, 1.5, 0);
      reference.advance(kDt, kDt * k);
    }
    EXPECT_LT((reference.pose().position - start).norm(), 0.03);
  }
}

// A goal that waits is meant for the end effector of before: a redefinition carries it along.
TEST(Pace, AGoalThatWaitsIsCarriedAlongWithTheFrame) {
  Reference reference = pose_reference();
  const Pose goal = moved(reference, {0, 0, -0.3}), X{rotation_from_rpy({0.2, 0, 0}), {0, 0.02, 0.1}};
  Vector6 pull = Vector6::Zero();
  pull[2] = -60;
  double t = 0;
  for (int k = 0; k < 500; ++k) {
    if (k == 100) {
      ASSERT_EQ(reference.post(pose_target(goal)), Verdict::accepted);
    }
    reference.resist(pull, 1.2, 0);
    reference.advance(kDt, t += kDt);
  }
  reference.carry(X);
  for (int k = 0; k < 8000; ++k) reference.advance(kDt, t += kDt);
  EXPECT_LT(pose_error(goal * X, reference.pose()).norm(), 1e-9);
}

// Goals and streams that arrive while the hand is blocked do not draw the set-point on,
// however fast they come, and turn it no farther.
TEST(Pace, TargetsThatArriveMeanwhileWait) {
  for (const bool turns : {false, true}) {
    for (const Delivery delivery : {Delivery::goal, Delivery::stream}) {
      Reference reference = pose_reference();
      const Pose start = reference.pose();
      const auto after = [&](double way) {
        Pose X = start;
        if (turns)
          X.rotation = exp_rotation({0, 0, -way}) * X.rotation;
        else
          X.position.z() -= way;
        return X;
      };
      const Pose goal = after(0.3);
      const Vector6 pull = -60 * Vector6::Unit(turns ? 5 : 2);
      double t = 0;
      for (int k = 0; k < 2000; ++k) {
        const Pose X = delivery == Delivery::stream ? after(0.25 * t) : goal;
        ASSERT_EQ(reference.post(pose_target(X, 0, delivery)), Verdict::accepted);
        reference.resist(pull, turns ? 0 : 1.2, turns ? 1.2 : 0);
        reference.advance(kDt, t += kDt);
      }
      EXPECT_LT(pose_error(start, reference.pose()).norm(), 0.03);
      if (delivery == Delivery::stream) continue;
      for (int k = 0; k < 5000; ++k) reference.advance(kDt, t += kDt);
      EXPECT_LT(pose_error(goal, reference.pose()).norm(), 1e-9);
    }
  }
}

// A wrist that turns moves the hand by a lever that grows on the way.
TEST(Pace, JointGoalsKeepTheHandWithinItsSpeed) {
  constexpr double kGreatest = 0.25;
  for (const Delivery delivery : {Delivery::goal, Delivery::stream}) {
    Reference reference({.name = "joints", .quantity = Quantity::joints, .max_speed = 2}, 2);
    JointVector q(2);
    q << 0.2, 2.6;
    reference.start(q);
    // A planar arm of two links: p = l (cos q1 + cos q12, sin q1 + sin q12, 0).
    constexpr double kLink = 0.5;
    const auto place = [&](const JointVector& at) {
      const double sum = at[0] + at[1];
      return Vector3(kLink * (std::cos(at[0]) + std::cos(sum)), kLink * (std::sin(at[0]) + std::sin(sum)), 0);
    };
    const auto jacobian = [&](const JointVector& at) {
      Jacobian J = Jacobian::Zero(6, 2);
      J.row(5).setOnes();
      const Vector3 p = place(at), elbow(kLink * std::cos(at[0]), kLink * std::sin(at[0]), 0);
      J.col(0).head<3>() = Vector3::UnitZ().cross(p);
      J.col(1).head<3>() = Vector3::UnitZ().cross(Vector3(p - elbow));
      return J;
    };
    Target target;
    target.size = 2;
    target.delivery = delivery;
    target.values[0] = 1.7;
    target.values[1] = 0.2;  // from folded to nearly stretched
    double t = 0, fastest = 0;
    for (int k = 0; k < 20000; ++k) {
      if (k == 0 || (delivery == Delivery::stream && k % 5 == 0)) {
        ASSERT_EQ(reference.post(target), Verdict::accepted);
      }
      const Vector3 before = place(reference.joints());
      reference.bound_hand_speed(kGreatest, jacobian(reference.joints()));
      reference.advance(kDt, t += kDt);
      fastest = std::max(fastest, (place(reference.joints()) - before).norm() / kDt);
    }
    EXPECT_LT(fastest, 1.05 * kGreatest);
    EXPECT_GT(fastest, 0.5 * kGreatest);
    EXPECT_NEAR(reference.joints()[0], 1.7, 1e-6);
    EXPECT_NEAR(reference.joints()[1], 0.2, 1e-6);
  }
}

// Only the part of a pull, force or moment, that grows along the motion counts.
TEST(Pace, WaitsForThePartThatTheMotionLoads) {
  const Vector3 way(0.1, -0.2, 0.1), turn(0.3, 0.2, -0.4);
  for (const bool translates : {false, true}) {
    for (const bool rotates : {false, true}) {
      for (const double force_along : {-1.0, 1.0}) {
        for (const double moment_along : {-1.0, 1.0}) {
          for (const auto& [force_share, moment_share, moment_per_force] :
               {std::tuple{2.0, 0.0, 0.1}, {0.0, 2.0, 0.1}, {2.0, 0.0, 10.0}}) {
            if (force_share > 0 && !translates) continue;  // rounding decides
            if (moment_share > 0 && !rotates) continue;
            Reference free = pose_reference(), reference = pose_reference();
            Pose goal = reference.pose();
            if (translates) goal.position += way;
            if (rotates) goal.rotation = exp_rotation(turn) * goal.rotation;
            Vector6 pull;
            pull << 50 * force_along * way, 50 * moment_per_force * moment_along * turn;
            ASSERT_EQ(free.post(pose_target(goal)), Verdict::accepted);
            ASSERT_EQ(reference.post(pose_target(goal)), Verdict::accepted);
            for (int k = 1; k < 1500; ++k) {
              if (k > 300) reference.resist(pull, force_share, moment_share);
              free.advance(kDt, kDt * k);
              reference.advance(kDt, kDt * k);
            }
            const bool waits = (translates && force_along > 0 && force_share > 0) ||
                               (rotates && moment_along > 0 && moment_share > 0);
            const double apart = (free.pose().position - reference.pose().position).norm() +
                                 (free.pose().rotation - reference.pose().rotation).norm();
            if (waits) {
              EXPECT_GT(apart, 0.05);
              EXPECT_LT(reference.twist().vector.norm(), 1e-6);
            } else {
              EXPECT_EQ(apart, 0) << translates << rotates << force_along << moment_along << force_share;
            }
          }
        }
      }
    }
  }
}

TEST(Pace, WaitsForAnyJointThatTheMotionLoads) {
  for (Eigen::Index joint = 0; joint < 7; ++joint) {
    for (const double along : {-1.0, 1.0}) {
      Reference reference({.name = "joints", .quantity = Quantity::joints}, 7);
      reference.start(joint_constant(7, 0.1));
      Target target;
      target.size = 7;
      target.values.fill(0.6);
      ASSERT_EQ(reference.post(target), Verdict::accepted);
      JointVector pull = joint_constant(7, 0);
      pull[joint] = 20 * along;
      double last = 0.1;
      for (int k = 1; k < 4000; ++k) {
        if (k > 300) reference.resist(pull, 1.5);
        reference.advance(kDt, kDt * k);
        const double now = reference.joints()[joint];
        EXPECT_NEAR((now - last) / kDt, reference.joint_velocity()[joint], 0.01);
        last = now;
      }
      if (along > 0) {
        EXPECT_LT(last, 0.5) << joint;
        EXPECT_LT(std::abs(reference.joint_velocity()[joint]), 1e-9);
      } else {
        EXPECT_NEAR(last, 0.6, 1e-9) << joint;
      }
    }
  }
}

// A second order of 30 rad/s, critically damped: 1 - (1 + w t) e^(-w t) of the way after t. Its share of the
// way falls linearly from 1 at four fifths of the allowed pull to 0 at all of it.
TEST(Pace, FollowsThePullAsACriticallyDampedSecondOrder) {
  for (const double share : {0.85, 0.9, 1.0, 3.0}) {
    Reference reference = pose_reference();
    ASSERT_EQ(reference.post(pose_target(moved(reference, {0, 0, 0.6}), 8)), Verdict::accepted);
    const double lowest = std::clamp((1 - share) / 0.2, 0.0, 1.0);
    double t = 0;
    const auto advance_by = [&](int count, double now) {
      for (int k = 0; k < count; ++k) {
        const Vector3 v = reference.twist().linear(), a = reference.acceleration().linear();
        reference.resist(Vector6::Unit(2), now, 0);
        reference.advance(1e-4, t += 1e-4);
        // The acceleration is that of the velocity.
        ASSERT_LT((reference.twist().linear() - v - 0.5e-4 * (a + reference.acceleration().linear())).norm(),
                  4e-6);
      }
    };
    const auto way_after = [](double tau) { return 1 - (1 + 30 * tau) * std::exp(-30 * tau); };
    advance_by(20000, 0);
    for (int k = 1; k <= 10; ++k) {
      advance_by(200, share);
      EXPECT_NEAR(reference.pace(), 1 - (1 - lowest) * way_after(0.02 * k), 3e-3) << share;
    }
    advance_by(8000, share);
    EXPECT_NEAR(reference.pace(), lowest, 1e-6) << share;
    for (int k = 1; k <= 10; ++k) {
      advance_by(200, 0);
      EXPECT_NEAR(reference.pace(), lowest + (1 - lowest) * way_after(0.02 * k), 3e-3) << share;
    }
    advance_by(6000, 0);
    EXPECT_EQ(reference.pace(), 1) << share;
    const Vector6 v = reference.twist().vector;
    advance_by(1, 0);
    const Vector6 a = reference.acceleration().vector;
    advance_by(1, 0);  // nothing is left of the rate of the pace
    EXPECT_LT(((reference.twist().vector - v) / 2e-4 - a).norm(), 1e-7) << share;
  }
}

// A goal that arrives in the last step in which the hand is blocked.
TEST(Pace, AGoalIsNotForgottenIfTheHandIsFreeAtOnce) {
  Reference reference = pose_reference();
  const Pose goal = moved(reference, {0, 0.1, -0.1});
  Vector6 pull = Vector6::Zero();
  pull.head<3>() << 0, 60, -60;
  double t = 0;
  for (int k = 0; k < 100; ++k) {
    reference.resist(pull, 1.2, 0);
    if (k == 99) {
      ASSERT_EQ(reference.post(pose_target(goal)), Verdict::accepted);
    }
    reference.advance(kDt, t += kDt);
  }
  for (int k = 0; k < 3000; ++k) reference.advance(kDt, t += kDt);
  EXPECT_LT((reference.pose().position - goal.position).norm(), 1e-9);
}

// A motion that the loop itself starts replaces a goal that waits, as one that is sent does.
TEST(Pace, AMotionReplacesAGoalThatWaits) {
  for (const bool sent : {false, true}) {
    Reference reference = pose_reference();
    const Vector3 start = reference.pose().position;
    Target circle{.delivery = Delivery::motion, .size = 3, .period_s = 2};
    circle.values = {0.05, 0, 0};
    double t = 0, farthest = 0;
    for (int k = 0; k < 4000; ++k) {
      if (k < 100) reference.resist(Vector6(-Vector6::Unit(2)), 1.2, 0);
      if (k == 50) {
        ASSERT_EQ(reference.post(pose_target(moved(reference, {0, 0, -0.3}))), Verdict::accepted);
      }
      if (k == 100 && sent) {
        ASSERT_EQ(reference.post(circle), Verdict::accepted);
      }
      if (k == 100 && !sent) reference.set(circle);
      reference.advance(kDt, t += kDt);
      farthest = std::max(farthest, (reference.pose().position - start).norm());
    }
    EXPECT_NEAR(farthest, 0.05, 1e-4) << sent;
    EXPECT_LT((reference.pose().position - start).norm(), 1e-9) << sent;
  }
}

TEST(Pace, GoalsThatWaitArePlannedOnce) {
  Reference reference = pose_reference();
  double t = 0;
  for (int k = 0; k < 150; ++k) {
    if (k < 100) {
      ASSERT_EQ(reference.post(pose_target(moved(reference, {0, 0, -0.3}))), Verdict::accepted);
      reference.resist(Vector6(-Vector6::Unit(2)), 1.2, 0);
    }
    reference.advance(kDt, t += kDt);
  }
  EXPECT_EQ(reference.planned(), 101u);  // each of them braked; the last one is approached now
}

// The lever of the joint grows on the way, after the motion was planned: its pace keeps the hand within its
// speed until the end of the motion, and is full where that is not needed.
TEST(Pace, FollowsALeverThatGrows) {
  constexpr double kGreatest = 0.2;
  for (const Delivery delivery : {Delivery::goal, Delivery::motion}) {
    Reference reference({.name = "joints", .quantity = Quantity::joints, .max_speed = 2}, 1);
    reference.start(joint_constant(1, 0));
    Target target;
    target.size = 1;
    target.delivery = delivery;
    target.values[0] = 1;
    target.duration_s = 3;
    target.period_s = 4;
    Jacobian J = Jacobian::Zero(6, 1);
    J(5, 0) = 1;
    J(0, 0) = 0.1;
    ASSERT_EQ(reference.post(target), Verdict::accepted);
    double t = 0, fastest = 0, late = 0;
    for (int k = 0; k < 20000; ++k) {
      if (k == 1200) J(0, 0) = 0.5;
      reference.bound_hand_speed(kGreatest, J);
      reference.advance(kDt, t += kDt);
      if (k < 1200) {
        EXPECT_EQ(reference.pace(), 1);
      }
      if (k < 1500) continue;
      const double speed = std::abs(J(0, 0) * reference.joint_velocity()[0]);
      fastest = std::max(fastest, speed);
      if (k < 2000) late = std::max(late, speed);
    }
    EXPECT_LT(fastest, 1.03 * kGreatest);
    EXPECT_GT(late, 0.9 * kGreatest);
    EXPECT_NEAR(reference.joints()[0], delivery == Delivery::goal ? 1 : 0, 1e-9);
  }
}

// Two axes on each other that move against each other: the hand rests, and what the first one moves keeps to
// the speed of a hand. Neither joint alone shows how fast the second one of two parallel axes is.
TEST(Pace, KeepsCarriagesWithinTheSpeedOfHands) {
  constexpr double kGreatest = 0.2;
  for (const double second : {-1.0, 1.0}) {
    for (const Delivery delivery : {Delivery::goal, Delivery::stream}) {
      Reference reference({.name = "joints", .quantity = Quantity::joints, .max_speed = 1}, 2);
      reference.start(joint_constant(2, 0));
      Jacobian J = Jacobian::Zero(6, 2);
      J(0, 0) = 0.6;
      J(1, 0) = 0.8;
      J.col(1) = second * J.col(0);
      J *= 1 + 1e-8;  // of a base that is not quite orthonormal
      Target target;
      target.size = 2;
      target.values[0] = target.values[1] = 0.5;
      target.delivery = delivery;
      double t = 0, fastest = 0;
      for (int k = 0; k < 10000; ++k) {
        if (k == 0 || (delivery == Delivery::stream && k % 5 == 0)) {
          ASSERT_EQ(reference.post(target), Verdict::accepted);
        }
        reference.bound_hand_speed(kGreatest, J);
        reference.advance(kDt, t += kDt);
        const JointVector& v = reference.joint_velocity();
        fastest = std::max({fastest, std::abs(v[0]), std::abs(v[0] + second * v[1])});
      }
      EXPECT_LT(fastest, 1.05 * kGreatest);
      EXPECT_GT(fastest, 0.5 * kGreatest);
      EXPECT_NEAR(reference.joints()[0], 0.5, 1e-6);
      EXPECT_NEAR(reference.joints()[1], 0.5, 1e-6);
    }
  }
}

// A frame between hands: the farthest point of each hand is by its lever and that farther from the axis.
TEST(Pace, FarthestPointsOfHandsOnALeverKeepToTheirSpeed) {
  Reference reference({.name = "pose", .max_speed = 1, .max_angular_speed = 2}, 7);
  reference.start(Pose{});
  ASSERT_EQ(reference.post(pose_target({exp_rotation({0.9, 1.8, 0}), {}}, 1)), Verdict::accepted);
  double fastest = 0;
  for (int k = 1; k < 8000; ++k) {
    reference.bound_hand_speed(0.25, 0.3);
    reference.bound_points(0.25, {}, 0.2);
    reference.advance(kDt, kDt * k);
    fastest = std::max(fastest, reference.twist().angular().norm());
  }
  EXPECT_LT(fastest, 1.03 * 0.25 / 0.5);
  EXPECT_GT(fastest, 0.9 * 0.25 / 0.5);
}

// Joints are no velocities of a pose: points of the hand that they do not move leave them their pace.
TEST(Pace, JointsThatMoveNoPointOfTheHandAreNotSlowed) {
  Reference reference({.name = "joints", .quantity = Quantity::joints, .max_speed = 2}, 7);
  reference.start(joint_constant(7, 0));
  Target target;
  target.size = 7;
  target.values.fill(1);
  ASSERT_EQ(reference.post(target), Verdict::accepted);
  double fastest = 0;
  for (int k = 1; k < 3000; ++k) {
    reference.bound_hand_speed(0.25, Jacobian::Zero(6, 7));
    reference.bound_points(0.25, std::array{Vector3(0.3, 0, 0), Vector3(0, 0.3, 0.1)}, 0.4);
    reference.advance(kDt, kDt * k);
    ASSERT_EQ(reference.pace(), 1);
    fastest = std::max(fastest, reference.joint_velocity()[3]);
  }
  EXPECT_GT(std::sqrt(3.0) * fastest, 0.25) << "the first three of a pose would be too fast";
}

// Without a Jacobian that is known, or before the first one, a joint reference keeps to its own limits.
TEST(Pace, IsFullWhereTheHandIsNotKnown) {
  Reference free({.name = "joints", .quantity = Quantity::joints}, 7);
  Reference reference({.name = "joints", .quantity = Quantity::joints}, 7);
  Target target;
  target.size = 7;
  target.values.fill(0.6);
  Jacobian unknown = Jacobian::Constant(6, 7, std::numeric_limits<double>::quiet_NaN());
  for (Reference* each : {&free, &reference}) {
    each->start(joint_constant(7, 0.1));
    ASSERT_EQ(each->post(target), Verdict::accepted);
  }
  for (int k = 1; k < 1500; ++k) {
    reference.bound_hand_speed(0.05, unknown);
    free.advance(kDt, kDt * k);
    reference.advance(kDt, kDt * k);
    ASSERT_EQ(free.joints(), reference.joints());
  }
}

}  // namespace
}  // namespace multipanda
